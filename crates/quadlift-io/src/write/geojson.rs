//! GeoJSON (RFC 7946): the objects as points on Earth with their figures, and the 95 % ellipses of their horizontal positions
//! as polygons. Longitude, latitude (degrees, WGS84) and height above the ellipsoid (meters).

use std::f64::consts::TAU;

use nalgebra::{Matrix2, Matrix3, SymmetricEigen, Vector2, Vector3};
use quadlift::geometry::ConvexBody;
use serde_json::{Map, Value, json};

use super::format::{ExportFormat, Writer};
use super::geodesy::{Crs, Place, Tangent};
use super::scores::Scores;
use super::{CheckedScene, Document, Object};
use crate::error::EntryError;
use crate::scene_file::REFERENCE;
use crate::wording::count;

/// Corners of the polygon of an ellipse.
const CORNERS: u32 = 64;

/// Probability of an ellipse.
const PROBABILITY: f64 = 0.95;

/// Farthest from the origin of a tangent plane, in meters: what is farther away has other coordinates.
const FARTHEST: f64 = 1e5;

/// Least sine of the angle between north and up.
const MIN_ANGLE: f64 = 0.1;

/// Where the scene is on Earth.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct GeoJsonOptions {
    /// Place of the world's origin; by default the `reference_lla` of the scene.
    pub origin: Option<Place>,
    /// The world's coordinates, where they are not those of a tangent plane.
    pub crs: Option<Crs>,
    /// World direction whose horizontal part is north; by default y.
    pub north: [f64; 3],
}

impl Default for GeoJsonOptions {
    fn default() -> Self {
        Self { origin: None, crs: None, north: [0.0, 1.0, 0.0] }
    }
}

/// The row of this format.
pub(super) const FORMAT: ExportFormat = ExportFormat {
    name: "geojson",
    about: "GeoJSON: objects as points on Earth with their error ellipses",
    options: &["enclosing", "origin", "crs", "north", "length_unit"],
    write: Writer::Bodies(|scene, options| {
        let about = GeoJsonOptions { origin: options.origin, crs: options.crs, north: options.north };
        geojson(scene, &about).map_err(|error| error.in_file(&options.scene))
    }),
};

/// The objects as a `FeatureCollection`.
///
/// # Errors
/// [`EntryError`] if there is no origin, the length unit or `up` is missing, north is parallel to `up`, or an object is far away
/// from the origin.
pub(super) fn geojson(scene: &CheckedScene, options: &GeoJsonOptions) -> Result<Document, EntryError> {
    let world = World::new(scene, options)?;
    let [x, y, z] = options.north;
    let mut notes = Vec::new();
    if options.crs.is_none() {
        notes.push(format!("north is the horizontal part of the world's ({x}, {y}, {z})"));
    }
    notes.extend(scene.meters().1);
    if options.origin.is_none() && options.crs.is_none() {
        notes.push(format!("the origin is the {REFERENCE} of the scene"));
    }
    let scores = Scores::known(scene);
    let mut features = Vec::new();
    let mut without = 0;
    for object in &scene.objects {
        let local = world.around(&object.body.center().coords);
        check_distance(object, &local)?;
        let record = scene.file.objects.iter().find(|record| record.id == object.id);
        let covariance = match (&object.covariance, record.and_then(|record| record.center_sd)) {
            (Some((covariance, _)), _) => Some(covariance.matrix.fixed_view::<3, 3>(0, 0).into_owned()),
            (None, sd) => sd.map(|sd| Matrix3::from_diagonal_element(sd * sd)),
        };
        let covariance = covariance.map(|c| local.east_north_up * c * local.east_north_up.transpose());
        features.push(point(&local, world.meters, object, covariance.as_ref(), scores.known_score(&object.id)));
        match covariance {
            Some(covariance) => features.push(ellipse(&local, object, &covariance)),
            None => without += 1,
        }
    }
    if without > 0 {
        notes.push(format!("{} without a covariance: no ellipse", count(without, "object")));
    }
    let counts = vec![("object", scene.objects.len()), ("ellipse", scene.objects.len() - without)];
    let document = json!({ "type": "FeatureCollection", "features": features });
    Ok(Document { content: format!("{document:#}\n").into_bytes(), counts, notes })
}

/// Rejects an object far away from the origin of its tangent plane: its world has other coordinates.
fn check_distance(object: &Object, local: &Local) -> Result<(), EntryError> {
    let distance = local.center.norm();
    if distance <= FARTHEST {
        return Ok(());
    }
    Err(EntryError::new(
        format!("objects, id \"{}\"", object.id),
        format!(
            "it is {:.0} km away from the origin; a world in UTM or Earth-centered coordinates needs --crs: EPSG:32633 for UTM zone 33 \
             north (32733 south), EPSG:4978 for Earth-centered",
            distance / 1000.0
        ),
    ))
}

/// From the world to the Earth.
struct World {
    frame: Frame,
    meters: f64,
}

/// What a world's coordinates are.
enum Frame {
    /// Those of a tangent plane, and the rotation to east, north, up, times the meters in the world unit.
    Plane(Tangent, Matrix3<f64>),
    Crs(Crs),
}

/// The surroundings of an object: a tangent plane, the object in it, and the map from the world to east, north, up in meters.
struct Local {
    tangent: Tangent,
    center: Vector3<f64>,
    east_north_up: Matrix3<f64>,
}

impl World {
    fn new(scene: &CheckedScene, options: &GeoJsonOptions) -> Result<Self, EntryError> {
        if let Some(crs) = options.crs {
            return Ok(Self { frame: Frame::Crs(crs), meters: meters(scene)? });
        }
        let reference = || scene.file.extra.get(REFERENCE).map(place).transpose();
        let Some(origin) = options.origin.map(Ok).or(reference().transpose()).transpose()? else {
            let problem = "missing; --origin LAT,LON,ALT sets the place of the world's origin on Earth";
            return Err(EntryError::new(REFERENCE, problem));
        };
        let meters = meters(scene)?;
        let Some(up) = scene.file.up.and_then(|up| Vector3::from(up).try_normalize(0.0)) else {
            return Err(EntryError::new("up", "there is none: places on Earth need the direction against gravity"));
        };
        let direction = Vector3::from(options.north);
        let direction = direction.try_normalize(0.0).unwrap_or(up);
        let level = direction - up * up.dot(&direction);
        if level.norm() < MIN_ANGLE {
            let problem = "north is parallel to it: set a world direction of north with --north X,Y,Z";
            return Err(EntryError::new("up", problem));
        }
        let north = level.normalize();
        let axes = Matrix3::from_columns(&[north.cross(&up), north, up]);
        Ok(Self { frame: Frame::Plane(Tangent::new(&origin), axes.transpose() * meters), meters })
    }

    /// The surroundings of a position in the world.
    fn around(&self, position: &Vector3<f64>) -> Local {
        match &self.frame {
            Frame::Plane(tangent, east_north_up) => {
                Local { tangent: *tangent, center: east_north_up * position, east_north_up: *east_north_up }
            }
            Frame::Crs(crs) => {
                let place = |at: Vector3<f64>| crs.place(&(at * self.meters));
                let tangent = Tangent::new(&place(*position));
                // Meters, of which a projection bends a ten millionth.
                let step = 1.0 / self.meters;
                let column = |axis: usize| {
                    let offset = Vector3::ith(axis, step);
                    let [before, after] = [-offset, offset].map(|offset| tangent.position(&place(position + offset)));
                    (after - before) / (2.0 * step)
                };
                let east_north_up = Matrix3::from_columns(&[column(0), column(1), column(2)]);
                Local { tangent, center: Vector3::zeros(), east_north_up }
            }
        }
    }
}

impl Local {
    /// Upwards in the world, a unit vector.
    fn up(&self) -> Vector3<f64> {
        self.east_north_up.row(2).transpose().normalize()
    }

    /// Longitude, latitude and height at an offset (east, north, up) from the object; the longitude is near the given one, so
    /// that a polygon is not torn at 180 degrees.
    fn coordinates(&self, offset: &Vector3<f64>, near: Option<f64>) -> [f64; 3] {
        let Place { latitude, mut longitude, altitude } = self.tangent.place(&(self.center + offset));
        if let Some(near) = near {
            longitude += 360.0 * ((near - longitude) / 360.0).round();
        }
        // A billionth of a degree is a tenth of a millimeter.
        [rounded(longitude, 9), rounded(latitude, 9), rounded(altitude, 4)]
    }
}

/// Meters in the world unit.
fn meters(scene: &CheckedScene) -> Result<f64, EntryError> {
    scene.known_meters().ok_or_else(|| {
        let found = scene.file.length_unit.as_deref().map_or("none".to_owned(), |unit| format!("\"{unit}\""));
        let problem = format!("found {found}, expected a unit such as \"m\": places on Earth need meters");
        EntryError::new("length_unit", problem)
    })
}

/// The place in the scene.
fn place(value: &Value) -> Result<Place, EntryError> {
    let number = |key: &str, most: f64| {
        let number = value.get(key).and_then(Value::as_f64).filter(|number| number.abs() <= most);
        number.ok_or_else(|| EntryError::new(format!("{REFERENCE}.{key}"), format!("expected a number up to {most}")))
    };
    Ok(Place {
        latitude: number("latitude", 90.0)?,
        longitude: number("longitude", 180.0)?,
        altitude: number("altitude", 1e9)?,
    })
}

fn rounded(x: f64, places: i32) -> f64 {
    let factor = 10f64.powi(places);
    (x * factor).round() / factor
}

fn point(local: &Local, meters: f64, object: &Object, covariance: Option<&Matrix3<f64>>, score: Option<f64>) -> Value {
    let up = local.up();
    let height = (object.body.support(&up) + object.body.support(&-up)) * meters;
    let size = object.body.half_extents * (2.0 * meters);
    let mut properties = Map::new();
    let mut set = |key: &str, value: Value| properties.insert(key.to_owned(), value);
    set("kind", json!("object"));
    set("id", json!(object.id));
    set("category", json!(object.category));
    set("score", json!(score));
    set("height", json!(rounded(height, 4)));
    set("size_1", json!(rounded(size.x, 4)));
    set("size_2", json!(rounded(size.y, 4)));
    set("size_3", json!(rounded(size.z, 4)));
    for (index, key) in ["sd_east", "sd_north", "sd_up"].into_iter().enumerate() {
        set(key, json!(covariance.map(|c| rounded(c[(index, index)].max(0.0).sqrt(), 6))));
    }
    let geometry = json!({ "type": "Point", "coordinates": local.coordinates(&Vector3::zeros(), None) });
    json!({ "type": "Feature", "geometry": geometry, "properties": properties })
}

/// The ellipse that contains the horizontal position with a probability of [`PROBABILITY`], at the height of the center.
fn ellipse(local: &Local, object: &Object, covariance: &Matrix3<f64>) -> Value {
    let level: Matrix2<f64> = covariance.fixed_view::<2, 2>(0, 0).into_owned();
    let eigen = SymmetricEigen::new(0.5 * (level + level.transpose()));
    // The square of the radius has the chi-square distribution with two degrees of freedom.
    let radius = (-2.0 * (1.0 - PROBABILITY).ln()).sqrt();
    let semi_axes = eigen.eigenvalues.map(|variance| radius * variance.max(0.0).sqrt());
    let longest = usize::from(semi_axes[1] > semi_axes[0]);
    let axis: Vector2<f64> = eigen.eigenvectors.column(longest).into_owned();
    let heading = axis.x.atan2(axis.y).to_degrees().rem_euclid(180.0);
    // Counterclockwise as seen from above, as RFC 7946 asks.
    let (first, second) = (axis * semi_axes[longest], Vector2::new(-axis.y, axis.x) * semi_axes[1 - longest]);
    let near = local.coordinates(&Vector3::zeros(), None)[0];
    let corner = |index: u32| {
        let (sin, cos) = (TAU * f64::from(index % CORNERS) / f64::from(CORNERS)).sin_cos();
        let offset = first * cos + second * sin;
        local.coordinates(&Vector3::new(offset.x, offset.y, 0.0), Some(near))
    };
    let ring: Vec<[f64; 3]> = (0..=CORNERS).map(corner).collect();
    json!({
        "type": "Feature",
        "geometry": { "type": "Polygon", "coordinates": [ring] },
        "properties": {
            "kind": "error_ellipse", "id": object.id, "category": object.category, "probability": PROBABILITY,
            "semi_major": rounded(semi_axes[longest], 6), "semi_minor": rounded(semi_axes[1 - longest], 6),
            "heading": rounded(heading, 3),
        },
    })
}

#[cfg(test)]
mod tests {
    use quadlift::solve::{Covariance, CovarianceCoordinates};

    use super::*;
    use crate::scene_file::SceneFile;
    use crate::write::BodyChoice;
    use crate::write::test_scene::three_bodies;

    const ORIGIN: Place = Place { latitude: 48.2, longitude: 16.37, altitude: 170.0 };

    fn export(file: &SceneFile, options: &GeoJsonOptions) -> Result<(Value, Document), EntryError> {
        let mut scene = CheckedScene::new(file, BodyChoice::Body)?;
        let mut matrix = nalgebra::SMatrix::<f64, 9, 9>::identity();
        matrix.fixed_view_mut::<2, 2>(0, 0).copy_from(&Matrix2::new(0.04, 0.03, 0.03, 0.09));
        let covariance = Covariance { coordinates: CovarianceCoordinates::CenterVechShape, matrix };
        scene.objects[0].covariance = Some((covariance, scene.objects[0].body));
        let document = geojson(&scene, options)?;
        Ok((serde_json::from_slice(&document.content).unwrap(), document))
    }

    #[test]
    fn objects_are_points_with_their_figures() {
        let options = GeoJsonOptions { origin: Some(ORIGIN), ..Default::default() };
        let (value, document) = export(&three_bodies(), &options).unwrap();
        assert_eq!(document.counts, [("object", 3), ("ellipse", 1)]);
        insta::assert_snapshot!(document.notes.join("\n"), @r"
    north is the horizontal part of the world's (0, 1, 0)
    2 objects without a covariance: no ellipse
    ");
        let features = value["features"].as_array().unwrap();
        let kinds: Vec<&str> = features.iter().map(|f| f["properties"]["kind"].as_str().unwrap()).collect();
        assert_eq!(kinds, ["object", "error_ellipse", "object", "object"]);
        let properties = r#"{"category":"cup","height":1.5,"id":"1","kind":"object","score":null,"sd_east":0.2,"sd_north":0.3,"sd_up":1.0,"size_1":1.0,"size_2":0.5,"size_3":1.5}"#;
        assert_eq!(features[0]["properties"].to_string(), properties);
        assert_eq!(features[0]["geometry"]["type"], "Point");
        // The center is (1, 0.5, 0) east, north, up.
        let place = Tangent::new(&ORIGIN).place(&Vector3::new(1.0, 0.5, 0.0));
        assert_eq!(features[0]["geometry"]["coordinates"][0], rounded(place.longitude, 9));
        assert_eq!(features[0]["properties"]["height"], 1.5);
    }

    #[test]
    fn ellipses_hold_95_percent() {
        let options = GeoJsonOptions { origin: Some(ORIGIN), ..Default::default() };
        let (value, _) = export(&three_bodies(), &options).unwrap();
        let ellipse = &value["features"][1];
        let ring = ellipse["geometry"]["coordinates"][0].as_array().unwrap();
        assert_eq!((ring.len(), &ring[0]), (65, &ring[64]));
        // Every corner has the Mahalanobis distance of the 95 % quantile of chi-square with 2 degrees of freedom, 5.991.
        // Degrees are converted with the radii of curvature at the origin.
        let (sin, cos) = ORIGIN.latitude.to_radians().sin_cos();
        let w = (1.0 - 0.006_694_379_990_141_32 * sin * sin).sqrt();
        let (across, along) =
            (6_378_137.0 / w + 170.0, 6_378_137.0 * (1.0 - 0.006_694_379_990_141_32) / w.powi(3) + 170.0);
        let inverse = Matrix2::new(0.04, 0.03, 0.03, 0.09).try_inverse().unwrap();
        let mut area = 0.0;
        let mut last: Option<Vector2<f64>> = None;
        for corner in ring {
            let degrees = [0, 1].map(|k| corner[k].as_f64().unwrap());
            let east = (degrees[0] - ORIGIN.longitude).to_radians() * across * cos - 1.0;
            let north = (degrees[1] - ORIGIN.latitude).to_radians() * along - 0.5;
            let d = Vector2::new(east, north);
            assert!(((d.transpose() * inverse * d)[0] - 5.991).abs() < 0.02, "{d}");
            area += last.map_or(0.0, |last| 0.5 * last.perp(&d));
            last = Some(d);
        }
        // Counterclockwise.
        assert!(area > 0.0);
        insta::assert_snapshot!(ellipse["properties"], @r#"
    {"category":"cup","heading":25.097,"id":"1","kind":"error_ellipse","probability":0.95,"semi_major":0.789569,"semi_minor":0.394298}
    "#);
    }

    #[test]
    fn the_world_may_have_other_axes_and_units() {
        // z down, north along x: the same scene after a turn, in millimeters.
        let upright = GeoJsonOptions { origin: Some(ORIGIN), ..Default::default() };
        let mut file = three_bodies();
        let (expected, _) = export(&file, &upright).unwrap();
        file.up = Some([0.0, 0.0, -1.0]);
        let center = file.objects[0].ellipsoid.as_mut().unwrap();
        // East is north x up: x cross -z = y.
        center.center = [500.0, 1000.0, 0.0];
        center.semi_axes = [250.0, 500.0, 750.0];
        file.length_unit = Some("mm".into());
        let turned = GeoJsonOptions { north: [2.0, 0.0, 0.3], ..upright };
        let (found, _) = export(&file, &turned).unwrap();
        assert_eq!(found["features"][0]["geometry"], expected["features"][0]["geometry"]);
        assert_eq!(found["features"][0]["properties"]["height"], 1.5);
    }

    #[test]
    fn worlds_in_utm_and_earth_centered_coordinates_are_placed() {
        let options = |crs| GeoJsonOptions { crs: Crs::of_name(crs), ..Default::default() };
        let moved = |by: [f64; 3]| {
            let mut file = three_bodies();
            file.up = None;
            let center = &mut file.objects[0].ellipsoid.as_mut().unwrap().center;
            *center = [0, 1, 2].map(|k| by[k] + center[k]);
            file.objects.truncate(1);
            file.detections.clear();
            file
        };
        // On the central meridian grid north is north; a meter of the grid is 1 / 0.9996 m, and more at a height.
        let (found, _) = export(&moved([5e5 - 1.0, 5_338_000.0, 170.0]), &options("EPSG:32633")).unwrap();
        let coordinates = |k: usize| found["features"][0]["geometry"]["coordinates"][k].as_f64().unwrap();
        assert_eq!((coordinates(0), coordinates(2)), (15.0, 170.0));
        assert!((coordinates(1) - 48.194).abs() < 0.01, "{}", coordinates(1));
        let properties = &found["features"][0]["properties"];
        assert_eq!((&properties["sd_east"], &properties["sd_north"]), (&json!(0.200085), &json!(0.300128)));
        assert_eq!(properties["height"], 1.5);
        // At latitude 0 and longitude 0 up is x, east is y and north is z.
        let (found, _) = export(&moved([6_378_137.0, -0.5, 0.0]), &options("EPSG:4978")).unwrap();
        assert_eq!(found["features"][0]["geometry"]["coordinates"], json!([0.0, 0.0, 1.0]));
        let properties = &found["features"][0]["properties"];
        assert_eq!(
            (&properties["sd_up"], &properties["sd_east"], &properties["sd_north"]),
            (&json!(0.2), &json!(0.3), &json!(1.0))
        );
        assert_eq!(properties["height"], 1.0);
        // Such a world is no tangent plane.
        let mut far = moved([5e5, 5_338_000.0, 170.0]);
        far.up = Some([0.0, 0.0, 1.0]);
        let error = export(&far, &GeoJsonOptions { origin: Some(ORIGIN), ..Default::default() }).unwrap_err();
        assert!(error.problem.contains("5361 km away from the origin") && error.problem.contains("--crs"), "{error:?}");
    }

    #[test]
    fn what_is_missing_is_named() {
        let error = |change: &dyn Fn(&mut SceneFile), options: &GeoJsonOptions| {
            let mut file = three_bodies();
            change(&mut file);
            let error = export(&file, options).unwrap_err();
            format!("{}: {}", error.entry, error.problem)
        };
        let options = GeoJsonOptions { origin: Some(ORIGIN), ..Default::default() };
        let lla = |latitude: f64| json!({ "latitude": latitude, "longitude": 16.37, "altitude": 170.0 });
        let messages = [
            error(&|_| {}, &GeoJsonOptions::default()),
            error(&|file| file.length_unit = None, &options),
            error(&|file| file.length_unit = Some("parsec".into()), &options),
            error(&|file| file.up = None, &options),
            error(&|file| file.up = Some([0.0, -1.0, 0.0]), &options),
            error(&|file| drop(file.extra.insert(REFERENCE.into(), lla(91.0))), &GeoJsonOptions::default()),
        ];
        insta::assert_snapshot!(messages.join("\n"), @r#"
    reference_lla: missing; --origin LAT,LON,ALT sets the place of the world's origin on Earth
    length_unit: found none, expected a unit such as "m": places on Earth need meters
    length_unit: found "parsec", expected a unit such as "m": places on Earth need meters
    up: there is none: places on Earth need the direction against gravity
    up: north is parallel to it: set a world direction of north with --north X,Y,Z
    reference_lla.latitude: expected a number up to 90
    "#);
        let mut file = three_bodies();
        file.extra.insert(REFERENCE.into(), lla(48.2));
        let (found, _) = export(&file, &GeoJsonOptions::default()).unwrap();
        assert_eq!(found["features"], export(&file, &options).unwrap().0["features"]);
    }
}

//! Places on the WGS84 ellipsoid from positions in a local frame (east, north, up at an origin), in UTM, or Earth-centered.

use nalgebra::{Matrix3, Vector3};

/// Semi-major axis of WGS84 in meters.
const MAJOR: f64 = 6_378_137.0;
/// Flattening of WGS84.
const FLATTENING: f64 = 1.0 / 298.257_223_563;
/// Square of the eccentricity.
const ECCENTRICITY_2: f64 = FLATTENING * (2.0 - FLATTENING);

/// A place on WGS84.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Place {
    /// Geodetic latitude in degrees, north positive.
    pub latitude: f64,
    /// Longitude in degrees, east positive, from -180 to 180.
    pub longitude: f64,
    /// Height above the ellipsoid in meters.
    pub altitude: f64,
}

/// The tangent frame at a place.
#[derive(Debug, Clone, Copy)]
pub(super) struct Tangent {
    /// The origin in the Earth-centered frame, meters.
    origin: Vector3<f64>,
    /// The columns are east, north and up in the Earth-centered frame.
    axes: Matrix3<f64>,
}

impl Tangent {
    pub(super) fn new(place: &Place) -> Self {
        let (sin_lat, cos_lat) = place.latitude.to_radians().sin_cos();
        let (sin_lon, cos_lon) = place.longitude.to_radians().sin_cos();
        let east = Vector3::new(-sin_lon, cos_lon, 0.0);
        let north = Vector3::new(-sin_lat * cos_lon, -sin_lat * sin_lon, cos_lat);
        let up = Vector3::new(cos_lat * cos_lon, cos_lat * sin_lon, sin_lat);
        let radius = radius(sin_lat);
        let foot = Vector3::new(radius * up.x, radius * up.y, radius * (1.0 - ECCENTRICITY_2) * sin_lat);
        Self { origin: foot + up * place.altitude, axes: Matrix3::from_columns(&[east, north, up]) }
    }

    /// The place of a position `(east, north, up)` in meters.
    pub(super) fn place(&self, position: &Vector3<f64>) -> Place {
        place_of(&(self.origin + self.axes * position))
    }

    /// The position `(east, north, up)` of a place.
    pub(super) fn position(&self, place: &Place) -> Vector3<f64> {
        self.axes.tr_mul(&(Self::new(place).origin - self.origin))
    }
}

/// The place of a position in the Earth-centered frame.
fn place_of(at: &Vector3<f64>) -> Place {
    let from_axis = at.x.hypot(at.y);
    let mut latitude = at.z.atan2(from_axis * (1.0 - ECCENTRICITY_2));
    // Each step reduces the error at least 150 times, by the square of the eccentricity.
    for _ in 0..10 {
        let sin = latitude.sin();
        latitude = (at.z + ECCENTRICITY_2 * radius(sin) * sin).atan2(from_axis);
    }
    let (sin, cos) = latitude.sin_cos();
    // Unlike division by the cosine this is exact at the poles too.
    let altitude = from_axis * cos + at.z * sin - MAJOR * (1.0 - ECCENTRICITY_2 * sin * sin).sqrt();
    Place { latitude: latitude.to_degrees(), longitude: at.y.atan2(at.x).to_degrees(), altitude }
}

/// Coordinates of a world on Earth, by their number in the EPSG registry.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Crs {
    /// UTM on WGS84 (or ETRS89, the same to a meter): easting, northing, height above the ellipsoid.
    Utm {
        /// 1 to 60.
        zone: u8,
        /// Whether it is one of the southern hemisphere.
        south: bool,
    },
    /// The Earth-centered frame.
    EarthCentered,
}

impl Crs {
    /// The coordinates of "EPSG:32633" and so on.
    pub(super) fn of_name(name: &str) -> Option<Self> {
        let number: u32 = name.trim().to_ascii_uppercase().strip_prefix("EPSG:")?.parse().ok()?;
        let utm = |first: u32, south| Some(Self::Utm { zone: (number - first) as u8, south });
        match number {
            32601..=32660 => utm(32600, false),
            32701..=32760 => utm(32700, true),
            25828..=25838 => utm(25800, false),
            4978 => Some(Self::EarthCentered),
            _ => None,
        }
    }

    /// The place of a position in meters.
    pub(super) fn place(self, position: &Vector3<f64>) -> Place {
        match self {
            Self::EarthCentered => place_of(position),
            Self::Utm { zone, south } => of_utm(zone, south, position),
        }
    }
}

/// The place of UTM coordinates by the series of Krueger to the fourth order (micrometers within a zone).
fn of_utm(zone: u8, south: bool, position: &Vector3<f64>) -> Place {
    let n = FLATTENING / (2.0 - FLATTENING);
    let [n2, n3, n4] = [2, 3, 4].map(|power| n.powi(power));
    let radius = MAJOR / (1.0 + n) * (1.0 + n2 / 4.0 + n4 / 64.0);
    let betas = [
        n / 2.0 - 2.0 / 3.0 * n2 + 37.0 / 96.0 * n3 - n4 / 360.0,
        n2 / 48.0 + n3 / 15.0 - 437.0 / 1440.0 * n4,
        17.0 / 480.0 * n3 - 37.0 / 840.0 * n4,
        4397.0 / 161_280.0 * n4,
    ];
    let deltas = [
        2.0 * n - 2.0 / 3.0 * n2 - 2.0 * n3 + 116.0 / 45.0 * n4,
        7.0 / 3.0 * n2 - 8.0 / 5.0 * n3 - 227.0 / 45.0 * n4,
        56.0 / 15.0 * n3 - 136.0 / 35.0 * n4,
        4279.0 / 630.0 * n4,
    ];
    let orders = [2.0, 4.0, 6.0, 8.0];
    let false_northing = if south { 1e7 } else { 0.0 };
    let [xi, eta] = [position.y - false_northing, position.x - 5e5].map(|x| x / (0.9996 * radius));
    let sum = |term: &dyn Fn(f64) -> f64| betas.iter().zip(orders).map(|(beta, order)| beta * term(order)).sum::<f64>();
    let north = xi - sum(&|order| (order * xi).sin() * (order * eta).cosh());
    let east = eta - sum(&|order| (order * xi).cos() * (order * eta).sinh());
    let conformal = (north.sin() / east.cosh()).asin();
    let latitude =
        conformal + deltas.iter().zip(orders).map(|(delta, order)| delta * (order * conformal).sin()).sum::<f64>();
    let longitude = 6.0 * f64::from(zone) - 183.0 + east.sinh().atan2(north.cos()).to_degrees();
    Place { latitude: latitude.to_degrees(), longitude, altitude: position.z }
}

/// The radius of curvature across the meridian.
fn radius(sin_latitude: f64) -> f64 {
    MAJOR / (1.0 - ECCENTRICITY_2 * sin_latitude * sin_latitude).sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Positions and places (longitude, latitude, altitude) by PROJ 9.5 (pyproj 3.7.2): inverse `topocentric`, inverse `cart`.
    #[test]
    fn places_are_those_of_proj() {
        #[rustfmt::skip]
        let cases = [
            ([48.2, 16.37, 170.0], [0.0, 0.0, 0.0], [16.37, 48.20000000000001, 170.00000000186265]),
            ([48.2, 16.37, 170.0], [12.5, -30.25, 4.5], [16.370168148877752, 48.19972796078673, 174.50008403789252]),
            ([48.2, 16.37, 170.0], [-30000.0, 40000.0, 1000.0], [15.96366589649668, 48.55893190186546, 1365.9488890562207]),
            ([-33.9, 151.2, 10.0], [1000.0, 2000.0, -50.0], [151.21080943266267, -33.88196846768483, -39.60698712710291]),
            ([0.0, 0.0, 0.0], [12.5, -30.25, 4.5], [0.00011228933129072347, -0.0002735715724899251, 4.500084467232227]),
            ([89.9, -120.0, 50.0], [-30000.0, 40000.0, 1000.0], [106.14061409919026, 89.6275660383263, 1245.289891124703]),
            ([10.0, 179.999, 0.0], [1000.0, 2000.0, -50.0], [-179.9918786125494, 10.01808192019402, -49.60602324642241]),
        ];
        for ([latitude, longitude, altitude], position, [lon, lat, height]) in cases {
            let tangent = Tangent::new(&Place { latitude, longitude, altitude });
            let found = tangent.place(&Vector3::from(position));
            // A ten millionth of a millimeter on the ground is 1e-12 degrees; PROJ's altitudes are good to 1e-8 m.
            assert!((found.latitude - lat).abs() < 1e-12, "{found:?} {lat}");
            assert!((found.longitude - lon).abs() < 1e-11, "{found:?} {lon}");
            assert!((found.altitude - height).abs() < 1e-7, "{found:?} {height}");
        }
    }

    /// Places by PROJ's formulas: `+proj=utm` inverse; see below.
    #[test]
    fn utm_and_earth_centered_coordinates() {
        let utm = Crs::of_name("EPSG:32633").unwrap();
        // The place of utm33.json by an independent Krueger series of the sixth order.
        let found = utm.place(&Vector3::new(601_816.701, 5_339_405.634, 170.083));
        assert!((found.latitude - 48.199_714).abs() < 1e-6 && (found.longitude - 16.370_229).abs() < 1e-6, "{found:?}");
        // On the central meridian the easting is that of the meridian, and the meridian arc to the equator is zero.
        let equator = utm.place(&Vector3::new(5e5, 0.0, 1.0));
        assert_eq!((equator.latitude, equator.longitude, equator.altitude), (0.0, 15.0, 1.0));
        // The arc from the equator to the pole is 10,001,965.729 m.
        let pole = utm.place(&Vector3::new(5e5, 0.9996 * 10_001_965.729, 0.0));
        assert!((pole.latitude - 90.0).abs() < 1e-8, "{pole:?}");
        // South and north mirror each other.
        let [north, south] = ["EPSG:32601", "epsg:32701"].map(|name| Crs::of_name(name).unwrap());
        let mirrored = south.place(&Vector3::new(7e5, 1e7 - 4e6, 0.0));
        let place = north.place(&Vector3::new(7e5, 4e6, 0.0));
        assert!((place.latitude + mirrored.latitude).abs() < 1e-12 && place.longitude == mirrored.longitude);
        assert!((place.longitude - -174.7).abs() < 0.2, "{place:?}");
        // Distances on the ground: 1 m in the grid is 1 / 0.9996 m on the central meridian.
        let tangent = Tangent::new(&utm.place(&Vector3::new(5e5, 5e6, 0.0)));
        let east = tangent.position(&utm.place(&Vector3::new(5e5 + 1.0, 5e6, 0.0)));
        assert!((east - Vector3::new(1.0 / 0.9996, 0.0, 0.0)).norm() < 1e-6, "{east}");
        for name in ["EPSG:32600", "EPSG:32661", "EPSG:4326", "32633", "EPSG:"] {
            assert_eq!(Crs::of_name(name), None, "{name}");
        }
        let place = Place { latitude: 48.2, longitude: 16.37, altitude: 170.0 };
        let found = Crs::of_name("EPSG:4978").unwrap().place(&Tangent::new(&place).origin);
        assert!((found.latitude - 48.2).abs() < 1e-12 && (found.altitude - 170.0).abs() < 1e-7, "{found:?}");
    }
}

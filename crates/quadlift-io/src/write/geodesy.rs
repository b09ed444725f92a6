//! Places on the WGS84 ellipsoid from positions in a local frame: east, north, up at an origin.

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
        let at = self.origin + self.axes * position;
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
}

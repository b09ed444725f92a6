//! Options of writers.

use std::path::PathBuf;

use super::geodesy::{Crs, Place};
use super::units::meters_of;
use crate::format_options::{FormatOption, name, number, path, whole};

/// The options of all formats; each writes with its own ([`super::format::ExportFormat::options`]).
#[derive(Debug, Clone, PartialEq)]
pub struct WriteOptions {
    /// Whether enclosing ellipsoids are written instead of the bodies.
    pub enclosing: bool,
    /// Depth of the camera frusta in world units; 0 omits them.
    pub frusta: Option<f64>,
    /// Only frames in which the object was detected, instead of all in which it is visible.
    pub only_detected: bool,
    /// KITTI calibration file of the sequence.
    pub calib: Option<PathBuf>,
    /// Number of the scene.
    pub scene_id: Option<u64>,
    /// Place of the world's origin; by default the `reference_lla` of the scene.
    pub origin: Option<Place>,
    /// The coordinates of a world that is one on Earth.
    pub crs: Option<Crs>,
    /// Unit of the lengths, in place of that of the scene.
    pub length_unit: Option<String>,
    /// World direction whose horizontal part is north.
    pub north: [f64; 3],
    /// Name of the world frame; by default "map".
    pub frame_id: Option<String>,
    /// Where a second table goes.
    pub views: Option<PathBuf>,
    /// Id of the camera.
    pub camera: Option<String>,
    /// The scene file, for messages.
    pub scene: PathBuf,
}

impl Default for WriteOptions {
    fn default() -> Self {
        Self {
            enclosing: false,
            frusta: None,
            only_detected: false,
            calib: None,
            scene_id: None,
            origin: None,
            crs: None,
            length_unit: None,
            north: [0.0, 1.0, 0.0],
            frame_id: None,
            views: None,
            camera: None,
            scene: PathBuf::new(),
        }
    }
}

#[cfg(feature = "mcap")]
impl WriteOptions {
    /// The name of the world frame.
    pub(super) fn frame(&self) -> &str {
        self.frame_id.as_deref().unwrap_or("map")
    }
}

type Write = FormatOption<WriteOptions>;

/// All options of writers.
pub const WRITE: &[Write] = &[
    Write::new(
        "enclosing",
        "",
        "Export the ellipsoids around the objects (of localize --enclosing) instead of the bodies",
        |o, _| {
            o.enclosing = true;
            Ok(())
        },
    ),
    Write::new(
        "frusta",
        "DEPTH",
        "Depth of the camera frusta in world units; 0 omits them (default: a tenth of the distance to the objects)",
        |o, text| {
            o.frusta = Some(number(text, |x| x >= 0.0, "a non-negative number")?);
            Ok(())
        },
    ),
    Write::new(
        "only_detected",
        "",
        "Write only the frames in which the object was detected, instead of all in which it is visible",
        |o, _| {
            o.only_detected = true;
            Ok(())
        },
    ),
    Write::new(
        "calib",
        "FILE",
        "KITTI calibration file of the sequence: write locations in the axes of camera 0",
        |o, text| path(&mut o.calib, text),
    ),
    Write::new("scene_id", "N", "Value of the column scene_id [default: 0]", |o, text| whole(&mut o.scene_id, text)),
    Write::new(
        "origin",
        "LAT,LON,ALT",
        "Place of the world's origin: degrees (WGS84), and meters above the ellipsoid (default: the scene's reference_lla)",
        |o, text| {
            let is_valid = |[latitude, longitude, _]: &[f64; 3]| latitude.abs() <= 90.0 && longitude.abs() <= 180.0;
            let [latitude, longitude, altitude] = three_numbers(text)
                .filter(is_valid)
                .ok_or_else(|| "expected LAT,LON,ALT in degrees and meters, such as 48.2,16.37,170".to_owned())?;
            o.origin = Some(Place { latitude, longitude, altitude });
            Ok(())
        },
    ),
    Write::new(
        "crs",
        "EPSG:N",
        "Coordinates of the world in place of an origin: UTM (EPSG:32601 to 32660 north, 32701 to 32760 south), or EPSG:4978, \
         Earth-centered",
        |o, text| {
            let expected =
                || "expected UTM, such as EPSG:32633 (zone 33 north), or EPSG:4978 (Earth-centered)".to_owned();
            o.crs = Some(Crs::of_name(text).ok_or_else(expected)?);
            Ok(())
        },
    ),
    Write::new("length_unit", "UNIT", "Unit of the lengths, such as m, if the scene does not say it", |o, text| {
        meters_of(text).ok_or_else(|| "expected a unit of lengths: m, dm, cm, mm, km, in or ft".to_owned())?;
        name(&mut o.length_unit, text)
    }),
    Write::new("north", "X,Y,Z", "World direction whose horizontal part is north [default: 0,1,0]", |o, text| {
        o.north = three_numbers(text).ok_or_else(|| "expected three numbers X,Y,Z".to_owned())?;
        Ok(())
    }),
    Write::new("frame_id", "NAME", "Name of the world frame in the headers [default: map]", |o, text| {
        name(&mut o.frame_id, text)
    }),
    Write::new("views", "FILE", "Write a second table with the residual of each view of each object", |o, text| {
        path(&mut o.views, text)
    }),
    Write::new("camera", "ID", "The camera, by its id in the scene, if frames have several", |o, text| {
        name(&mut o.camera, text)
    }),
];

fn three_numbers(text: &str) -> Option<[f64; 3]> {
    let numbers: Option<Vec<f64>> = text.split(',').map(|word| word.trim().parse().ok()).collect();
    numbers?.try_into().ok().filter(|numbers: &[f64; 3]| numbers.iter().all(|x| x.is_finite()))
}

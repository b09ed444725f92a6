//! Options of synthetic scenes and their validation.

use nalgebra::Vector3;

use crate::geometry::{BodyKind, BoundingBoxError, CameraError, EllipseError, ProjectionError};
use crate::scene::SceneError;

/// Options of a synthetic scene; the default is the set-up of PfD's synthetic experiments, without noise.
#[derive(Debug, Clone, PartialEq)]
pub struct SyntheticOptions {
    /// Seed of the random numbers. Objects, every kind of noise and outliers have independent streams: changing one
    /// does not affect the others.
    pub seed: u64,
    /// Number of objects. The first n objects and their noise are the same for any greater number.
    pub objects: usize,
    /// Kind of the bodies; the half extents of cuboids are drawn like the semi-axes of ellipsoids.
    pub body: BodyKind,
    /// Kinds of the objects in turn, instead of `body`; empty if all are of one kind. Positions, sizes and rotations do
    /// not depend on the kinds.
    pub kinds: Vec<BodyKind>,
    /// Whether objects stand upright on the plane z = 0, with a vertical third axis and an arbitrary rotation about it.
    pub standing: bool,
    /// Number of views.
    pub views: usize,
    /// Camera positions.
    pub trajectory: Trajectory,
    /// Side of the cube that contains the centers of the objects, in world units before `scale`.
    pub cube_side: f64,
    /// Distance of the cameras from the center of the objects, in world units before `scale`.
    pub distance: f64,
    /// Factor on the whole world (positions, sizes, distance); the pixels stay the same.
    pub scale: f64,
    /// Added to the whole world after `scale`; the pixels stay the same.
    pub offset: Vector3<f64>,
    /// What is measured in the images.
    pub observations: Observations,
    /// The noises, each independent of the others; their order does not matter.
    pub noise: Vec<Noise>,
    /// Probability, in [0, 1], that a detection is replaced by a wrong box near the true one.
    pub outlier_share: f64,
    /// Standard deviation of the systematic error of the left, top, right and bottom edge of each object, the same in
    /// all of its boxes, in units of their mean half sizes.
    pub edge_bias: f64,
    /// Standard deviation of the error of the cameras' rotations about each of their axes, in degrees: the cameras of
    /// the scene differ slightly from those of the measurements.
    pub pose_noise: f64,
    /// Misses and false positives of the detector.
    pub detector: Detector,
    /// Object ids of the detections.
    pub ids: SyntheticIds,
    /// Number of points about the objects; each is tracked through 3 to 20 frames, and points that fewer frames see are left out.
    pub points: usize,
    /// Standard deviation of each component of the pixel of an observation.
    pub point_noise: f64,
    /// Probability, in [0, 1], that an observation is of something else, anywhere in the image.
    pub point_mismatches: f64,
}

/// Misses and false positives of a detector (ours); the default is a perfect detector.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Detector {
    /// Probability, in [0, 1], that a visible object is not detected.
    pub misses: f64,
    /// Mean number of false boxes per true box, with the sizes and positions of the true boxes of the frame.
    pub false_boxes: f64,
    /// Probability, in [0, 1], that an object is detected twice, by a second box with edges off by 0.12 mean half
    /// sizes.
    pub duplicates: f64,
    /// Whether objects occlude each other: an object that is covered by more than 65 % is missed.
    pub occlusion: bool,
}

/// Object ids of the detections; false boxes and duplicates never have one.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub enum SyntheticIds {
    /// The truth.
    #[default]
    True,
    /// Nothing.
    Absent,
    /// Ids of a simulated tracker.
    Tracks {
        /// Probability, in [0, 1], at every detection that its track ends and a new one begins.
        fragments: f64,
        /// Probability, in [0, 1], at every detection that its track and that of the nearest other object in the frame
        /// are swapped from then on.
        switches: f64,
    },
}

impl Default for SyntheticOptions {
    fn default() -> Self {
        Self {
            seed: 0,
            objects: 50,
            body: BodyKind::Ellipsoid,
            kinds: Vec::new(),
            standing: false,
            views: 20,
            trajectory: Trajectory::default(),
            distance: 200.0,
            cube_side: 20.0,
            scale: 1.0,
            offset: Vector3::zeros(),
            observations: Observations::Ellipses,
            noise: Vec::new(),
            outlier_share: 0.0,
            edge_bias: 0.0,
            pose_noise: 0.0,
            detector: Detector::default(),
            ids: SyntheticIds::default(),
            points: 0,
            point_noise: 0.5,
            point_mismatches: 0.0,
        }
    }
}

/// Camera positions.
///
/// On `Paper`, `Arc` and `Orbit` they look at the center of the objects from a distance, and every object must be in
/// front of them; nothing is cut off at the image border. With `Random` and `Street`, objects that lie at least half
/// inside the image are visible, and boxes are clipped at its border.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Trajectory {
    /// Azimuth and elevation from 0 to the given angles (PfD section 5.1: 60 and 70 degrees).
    Paper {
        /// Last azimuth, degrees.
        azimuth: f64,
        /// Last elevation, degrees.
        elevation: f64,
    },
    /// Azimuth from 0 to `span`, elevation from 20 to `20 + 20 span / 90` degrees (ours).
    Arc {
        /// Last azimuth, degrees.
        span: f64,
    },
    /// Once around, at elevations from 20 to 50 degrees (ours).
    Orbit,
    /// Cameras anywhere above the objects, which lie on a floor, each looking at a place among them; the distance is not
    /// used (ours).
    Random,
    /// A drive of one world unit per view along a street of parked cars, one every six units on both sides, in the order
    /// of the drive, detected up to 45 units ahead; distance and side of the cube are not used. Views / 3 + 17 objects
    /// fill the street (ours).
    Street,
}

impl Trajectory {
    /// Whether objects may lie outside of the image.
    pub(super) fn is_free(self) -> bool {
        matches!(self, Self::Random | Self::Street)
    }

    /// Depth beyond which objects are too small to be detected, in world units before the scene's scale.
    pub(super) fn range(self) -> f64 {
        if self == Self::Street { 45.0 } else { f64::INFINITY }
    }
}

impl Default for Trajectory {
    fn default() -> Self {
        Self::Paper { azimuth: 60.0, elevation: 70.0 }
    }
}

/// What is measured in the images.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default)]
pub enum Observations {
    /// Outlines, which are ellipses: of ellipsoids only.
    #[default]
    Ellipses,
    /// Tight boxes.
    Boxes,
    /// Ellipses and boxes.
    Both,
}

impl Observations {
    /// Whether ellipses are measured.
    pub(crate) fn ellipses(self) -> bool {
        self != Self::Boxes
    }

    /// Whether boxes are measured.
    pub(crate) fn boxes(self) -> bool {
        self != Self::Ellipses
    }
}

/// A kind of noise and its amount. The uniform ones are those of PfD section 5.1 and act on ellipses, drawn
/// from `[-amount, amount]` independently for each view.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Noise {
    /// RE: added to the angle of the ellipse; degrees.
    Rotation(f64),
    /// SE: both semi-axes times 1 + noise, one factor for both; in [0, 1).
    Size(f64),
    /// SE2: a separate factor for each semi-axis; in [0, 1).
    SizePerAxis(f64),
    /// TE: added to the center in x and y, in units of the mean semi-axis of the exact ellipse.
    Translation(f64),
    /// TE2: the same in units of the mean full axis.
    TranslationFullAxis(f64),
    /// Gaussian noise of each box edge (ours): its standard deviation in units of the mean half size of the exact box.
    BoxEdges(f64),
}

impl Noise {
    /// The amount, in the unit of the kind.
    pub(crate) fn amount(self) -> f64 {
        match self {
            Self::Rotation(m)
            | Self::Size(m)
            | Self::SizePerAxis(m)
            | Self::Translation(m)
            | Self::TranslationFullAxis(m)
            | Self::BoxEdges(m) => m,
        }
    }

    /// The name of the kind in messages.
    pub fn name(self) -> &'static str {
        match self {
            Self::Rotation(_) => "rotation noise",
            Self::Size(_) => "size noise",
            Self::SizePerAxis(_) => "size noise per axis",
            Self::Translation(_) => "translation noise",
            Self::TranslationFullAxis(_) => "translation noise by full axes",
            Self::BoxEdges(_) => "box edge noise",
        }
    }
}

/// Why a synthetic scene cannot be made.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum SyntheticError {
    /// An option is outside of its range.
    #[error("the {what} is {value}; expected {expected}")]
    OutOfRange {
        /// The option.
        what: &'static str,
        /// Its value.
        value: f64,
        /// Its allowed values.
        expected: &'static str,
    },
    /// Ellipses are requested for bodies whose outlines are not ellipses.
    #[error("only ellipsoids have elliptical outlines; observe boxes instead")]
    NotAnEllipse,
    /// A noise affects a measurement that is not observed.
    #[error("{0} cannot be applied: noise and bias of box edges need boxes, all other noise needs ellipses")]
    NoiseWithoutObservation(&'static str),
    /// An object has no outline in a view.
    #[error("{object} cannot be seen in frame {frame}: {reason}")]
    NotInView {
        /// Id of the object.
        object: String,
        /// Id of the frame.
        frame: String,
        /// Why it has no outline.
        reason: ProjectionError,
    },
    /// A camera is not valid.
    #[error(transparent)]
    Camera(#[from] CameraError),
    /// A noisy box is not valid.
    #[error(transparent)]
    Box(#[from] BoundingBoxError),
    /// A noisy ellipse is not valid.
    #[error(transparent)]
    Ellipse(#[from] EllipseError),
    /// The scene is not valid.
    #[error(transparent)]
    Scene(#[from] SceneError),
}

impl SyntheticOptions {
    /// Kind of the object with this number.
    pub(crate) fn kind_of(&self, object: usize) -> BodyKind {
        if self.kinds.is_empty() { self.body } else { self.kinds[object % self.kinds.len()] }
    }

    /// Rejects invalid options.
    pub(super) fn check(&self) -> Result<(), SyntheticError> {
        let positive = |x: f64| x.is_finite() && x > 0.0;
        let out_of_range = |what, value, expected| Err(SyntheticError::OutOfRange { what, value, expected });
        if !positive(self.distance) {
            return out_of_range("distance", self.distance, "a positive number");
        }
        if !positive(self.scale) {
            return out_of_range("scale", self.scale, "a positive number");
        }
        if !positive(self.cube_side) {
            return out_of_range("side of the cube", self.cube_side, "a positive number");
        }
        let not_negative = |x: f64| x.is_finite() && x >= 0.0;
        if !not_negative(self.pose_noise) {
            return out_of_range("pose noise", self.pose_noise, "a number that is not negative");
        }
        if !not_negative(self.point_noise) {
            return out_of_range("noise of points", self.point_noise, "a number that is not negative");
        }
        if !not_negative(self.detector.false_boxes) {
            return out_of_range("number of false boxes", self.detector.false_boxes, "a number that is not negative");
        }
        let (fragments, switches) = match self.ids {
            SyntheticIds::Tracks { fragments, switches } => (fragments, switches),
            _ => (0.0, 0.0),
        };
        for (what, share) in [
            ("share of misses", self.detector.misses),
            ("share of duplicates", self.detector.duplicates),
            ("share of fragments", fragments),
            ("share of switches", switches),
            ("share of wrong observations", self.point_mismatches),
        ] {
            if !(0.0..=1.0).contains(&share) {
                return out_of_range(what, share, "a number from 0 to 1");
            }
        }
        if let Some(&x) = self.offset.iter().find(|x| !x.is_finite()) {
            return out_of_range("offset", x, "finite numbers");
        }
        if !(0.0..=1.0).contains(&self.outlier_share) {
            return out_of_range("outlier share", self.outlier_share, "a number from 0 to 1");
        }
        for kind in (0..self.kinds.len().max(1)).map(|object| self.kind_of(object)) {
            if !(1.0..=2.0).contains(&kind.exponent()) {
                return out_of_range("exponent of the superellipsoid", kind.exponent(), "a number from 1 to 2");
            }
            if self.observations.ellipses() && kind != BodyKind::Ellipsoid {
                return Err(SyntheticError::NotAnEllipse);
            }
        }
        if !not_negative(self.edge_bias) {
            return out_of_range("edge bias", self.edge_bias, "a number that is not negative");
        }
        if self.edge_bias > 0.0 && !self.observations.boxes() {
            return Err(SyntheticError::NoiseWithoutObservation("edge bias"));
        }
        for &noise in &self.noise {
            let (amount, on_boxes) = (noise.amount(), matches!(noise, Noise::BoxEdges(_)));
            if !amount.is_finite() || amount < 0.0 {
                return out_of_range(noise.name(), amount, "a number that is not negative");
            }
            if matches!(noise, Noise::Size(_) | Noise::SizePerAxis(_)) && amount >= 1.0 {
                return out_of_range(noise.name(), amount, "a number below 1");
            }
            if !(if on_boxes { self.observations.boxes() } else { self.observations.ellipses() }) {
                return Err(SyntheticError::NoiseWithoutObservation(noise.name()));
            }
        }
        Ok(())
    }
}

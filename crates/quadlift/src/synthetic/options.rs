//! What can be chosen about a synthetic scene, and what is refused.

use nalgebra::Vector3;

use crate::geometry::{BoundingBoxError, CameraError, EllipseError, ProjectionError};
use crate::scene::SceneError;
use crate::solve::BodyKind;

/// Everything that can be chosen about a synthetic scene; the default is the set-up of PfD's synthetic experiments,
/// without noise.
#[derive(Debug, Clone, PartialEq)]
pub struct SyntheticOptions {
    /// Seed of everything that is drawn. Objects, every kind of noise and outliers have draws of their own: changing
    /// one leaves the others as they are.
    pub seed: u64,
    /// Number of objects. The first n objects and their noise are the same for any greater number.
    pub objects: usize,
    /// Kind of the bodies; the half extents of cuboids are drawn like the semi-axes of ellipsoids.
    pub body: BodyKind,
    /// Number of views.
    pub views: usize,
    /// Where the cameras stand.
    pub trajectory: Trajectory,
    /// Distance of the cameras from the centre of the objects, in world units before `scale`.
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
}

impl Default for SyntheticOptions {
    fn default() -> Self {
        Self {
            seed: 0,
            objects: 50,
            body: BodyKind::Ellipsoid,
            views: 20,
            trajectory: Trajectory::default(),
            distance: 200.0,
            scale: 1.0,
            offset: Vector3::zeros(),
            observations: Observations::Ellipses,
            noise: Vec::new(),
            outlier_share: 0.0,
        }
    }
}

/// Where the cameras stand; all of them look at the centre of the objects, and the angles (degrees) are linear in the
/// index of the view.
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
    pub fn ellipses(self) -> bool {
        self != Self::Boxes
    }

    /// Whether boxes are measured.
    pub fn boxes(self) -> bool {
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
    /// SE2: a factor of its own for each semi-axis; in [0, 1).
    SizePerAxis(f64),
    /// TE: added to the centre in x and y, in units of the mean semi-axis of the exact ellipse.
    Translation(f64),
    /// TE2: the same in units of the mean full axis.
    TranslationFullAxis(f64),
    /// Gaussian noise of each box edge (ours): its standard deviation in units of the mean half size of the exact box.
    BoxEdges(f64),
}

impl Noise {
    /// The amount, in the unit of the kind.
    pub fn amount(self) -> f64 {
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
pub enum SyntheticError {
    /// An option is outside of its range.
    #[error("the {what} is {value}; expected {expected}")]
    OutOfRange {
        /// The option.
        what: &'static str,
        /// Its value.
        value: f64,
        /// What it may be.
        expected: &'static str,
    },
    /// Ellipses are asked of bodies whose outlines are none.
    #[error("only ellipsoids have ellipses as their outlines; observe boxes instead")]
    NotAnEllipse,
    /// A noise acts on what is not observed.
    #[error("{0} has nothing to act on: box edge noise needs boxes, every other noise ellipses")]
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
    /// Refuses what would not give a scene.
    pub(super) fn check(&self) -> Result<(), SyntheticError> {
        let positive = |x: f64| x.is_finite() && x > 0.0;
        let out_of_range = |what, value, expected| Err(SyntheticError::OutOfRange { what, value, expected });
        if !positive(self.distance) {
            return out_of_range("distance", self.distance, "a positive number");
        }
        if !positive(self.scale) {
            return out_of_range("scale", self.scale, "a positive number");
        }
        if let Some(&x) = self.offset.iter().find(|x| !x.is_finite()) {
            return out_of_range("offset", x, "finite numbers");
        }
        if !(0.0..=1.0).contains(&self.outlier_share) {
            return out_of_range("outlier share", self.outlier_share, "a number from 0 to 1");
        }
        if let BodyKind::Superellipsoid(q) = self.body
            && !(1.0..=2.0).contains(&q)
        {
            return out_of_range("exponent of the superellipsoid", q, "a number from 1 to 2");
        }
        if self.observations.ellipses() && self.body != BodyKind::Ellipsoid {
            return Err(SyntheticError::NotAnEllipse);
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

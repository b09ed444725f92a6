//! The tested mistakes, in order of preference: of two that explain a scene equally well the first one is reported.

use nalgebra::Vector2;

use super::cause::CauseName;
use super::correction::{BoxFormat, Correction};

/// Corrections without a parameter.
pub(crate) fn discrete(frame_ids: &[&str]) -> Vec<Correction> {
    let mut all = vec![
        Correction::InvertPoses,
        Correction::OpenGlAxes,
        Correction::InvertOpenGlPoses,
        Correction::NormalizedBoxes,
        Correction::NormalizedIntrinsics,
        Correction::CenteredPrincipalPoint,
        Correction::CenterAsTranslation,
        Correction::TransposedRotation,
        Correction::BodyAxes,
        Correction::InvertBodyPoses,
        Correction::LeftHandedAxes,
        Correction::InvertLeftHandedPoses,
        Correction::NormalizedLetterbox,
    ];
    for was_wxyz in [true, false] {
        for world_from_cam in [true, false] {
            all.push(Correction::QuaternionOrder { was_wxyz, world_from_cam });
        }
    }
    all.extend(
        [
            BoxFormat::CornersReadAsSize,
            BoxFormat::CenterReadAsCorner,
            BoxFormat::CornerReadAsCenter,
            BoxFormat::CornersReadAsCenter,
            BoxFormat::SwappedAxes,
            BoxFormat::SizeReadAsCorners,
            BoxFormat::CenterSizeReadAsCorners,
        ]
        .map(Correction::Boxes),
    );
    // Exchanged axes are among the formats.
    for (orientation, fractions) in [
        (6, false),
        (8, false),
        (3, false),
        (2, false),
        (4, false),
        (7, false),
        (6, true),
        (8, true),
        (5, true),
        (7, true),
    ] {
        all.push(Correction::TurnedPictures { orientation, fractions });
    }
    all.extend([Correction::AlphabeticalFrames, Correction::NumericFrames, Correction::ReversedFrames]);
    all.extend([1, -1, 2, -2, 3, -3, 4, -4, 5, -5, 10, -10].map(Correction::FrameOffset));
    // An order of names that changes nothing is not an explanation.
    all.retain(|correction| {
        correction.frames(frame_ids).is_none_or(|frames| frames.iter().enumerate().any(|(k, to)| *to != Some(k)))
    });
    all
}

/// A family of corrections with a number to find.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Family {
    /// The correction with a number.
    pub make: fn(f64) -> Correction,
    /// Grid of parameter values, ascending.
    pub grid: &'static [f64],
    /// Whether the parameter is a factor, which is searched in its logarithm.
    pub is_factor: bool,
}

impl Family {
    /// Numbers a share of the way between two of the grid.
    pub(crate) fn between(&self, low: f64, high: f64, share: f64) -> f64 {
        if self.is_factor { low * (high / low).powf(share) } else { low + (high - low) * share }
    }
}

/// The families.
pub(crate) const FAMILIES: [Family; 4] = [
    Family {
        make: Correction::ImageScale,
        grid: &[0.2, 0.25, 0.33, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 1.11, 1.25, 1.5, 1.75, 2.0, 2.5, 3.0, 4.0, 5.0],
        is_factor: true,
    },
    Family {
        make: Correction::FocalFactor,
        grid: &[0.25, 0.35, 0.5, 0.63, 0.75, 0.87, 1.15, 1.33, 1.6, 2.0, 2.8, 4.0],
        is_factor: true,
    },
    Family {
        make: Correction::Letterbox,
        grid: &[256.0, 320.0, 416.0, 512.0, 640.0, 800.0, 1024.0, 1280.0, 1536.0],
        is_factor: true,
    },
    Family { make: Correction::RadialDistortion, grid: &[-0.4, -0.25, -0.1, 0.1, 0.25], is_factor: false },
];

impl Correction {
    /// The mistake that it undoes.
    pub fn cause(self) -> CauseName {
        match self {
            Self::InvertPoses => CauseName::CameraToWorld,
            Self::OpenGlAxes => CauseName::OpenGlAxes,
            Self::InvertOpenGlPoses => CauseName::OpenGlCameraToWorld,
            Self::BodyAxes => CauseName::BodyAxes,
            Self::InvertBodyPoses => CauseName::BodyToWorld,
            Self::LeftHandedAxes => CauseName::LeftHandedAxes,
            Self::InvertLeftHandedPoses => CauseName::LeftHandedCameraToWorld,
            Self::CenterAsTranslation => CauseName::CenterAsTranslation,
            Self::TransposedRotation => CauseName::TransposedRotation,
            Self::QuaternionOrder { .. } => CauseName::QuaternionOrder,
            Self::FocalFactor(_) => CauseName::FocalLength,
            Self::NormalizedIntrinsics => CauseName::NormalizedIntrinsics,
            Self::CenteredPrincipalPoint => CauseName::PrincipalPoint,
            Self::RadialDistortion(_) => CauseName::MissingDistortion,
            Self::ImageScale(_) => CauseName::ImageSize,
            Self::Letterbox(_) | Self::NormalizedLetterbox => CauseName::Letterbox,
            Self::NormalizedBoxes => CauseName::NormalizedBoxes,
            Self::TurnedPictures { .. } => CauseName::PictureOrientation,
            Self::Boxes(BoxFormat::SwappedAxes) => CauseName::SwappedXy,
            Self::Boxes(_) => CauseName::BoxFormat,
            Self::FrameOffset(_) => CauseName::FrameOffset,
            Self::AlphabeticalFrames | Self::NumericFrames | Self::ReversedFrames => CauseName::FrameOrder,
            Self::Up(_) => CauseName::Up,
            Self::Lengths(_) => CauseName::LengthUnit,
        }
    }

    /// The factor by which it enlarges the viewing angles of boxes, for corrections with a parameter.
    pub(crate) fn angular_growth(self, image_size: Option<Vector2<f64>>) -> f64 {
        match self {
            Self::FocalFactor(factor) => 1.0 / factor,
            Self::ImageScale(factor) => factor,
            Self::Letterbox(side) => image_size.map_or(1.0, |size| size.max() / side),
            _ => 1.0,
        }
    }

    /// Its number, see [`super::Cause::value`].
    pub fn value(self) -> Option<f64> {
        match self {
            Self::FocalFactor(x)
            | Self::ImageScale(x)
            | Self::Letterbox(x)
            | Self::RadialDistortion(x)
            | Self::Lengths(x) => Some(x),
            Self::FrameOffset(n) => Some(f64::from(n)),
            Self::TurnedPictures { orientation, .. } => Some(f64::from(orientation)),
            _ => None,
        }
    }
}

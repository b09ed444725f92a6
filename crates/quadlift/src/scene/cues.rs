//! What detections tell besides boxes and ellipses: depths and 3D boxes.

use nalgebra::{Point3, Rotation3, Vector3};

/// What a detection tells besides its box and its ellipse. Solved by [`crate::solve::Method::Posterior`] only; the other methods do not
/// use it (docs/method.md, section 19).
#[derive(Debug, Clone, Copy, PartialEq, Default)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Cues {
    /// How far the visible surface of the object is.
    pub depth: Option<DepthCue>,
    /// A 3D box of the object, from this image alone.
    pub box3d: Option<Box3dCue>,
}

/// How far the visible surface of an object is: from a depth image, a depth network, LiDAR or other points.
#[derive(Debug, Clone, Copy, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct DepthCue {
    /// Median depth of the visible surface along the optical axis, world units.
    pub median: f64,
    /// Standard deviation of its error, world units; 10 % of the depth if not given.
    pub sd: Option<f64>,
    /// Index into [`super::SceneParts::cue_sources`]: depths of one source may share a wrong scale.
    pub source: Option<u32>,
}

/// A 3D box of an object from one image, any part of it, in the frame of the camera: x to the right, y down, z forwards.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Box3dCue {
    /// Center in the frame of the camera, world units; in front of the camera.
    pub center: Option<Point3<f64>>,
    /// Half the length, width and height (or half the extents along the axes of `rotation`), world units.
    pub half_extents: Option<Vector3<f64>>,
    /// Rotation from the axes of the box to those of the camera.
    pub rotation: Option<Rotation3<f64>>,
    /// Standard deviations of the errors.
    pub sd: Box3dSd,
    /// Index into [`super::SceneParts::cue_sources`]: boxes of one source may share wrong distances and sizes.
    pub source: Option<u32>,
}

/// Standard deviations of the errors of a 3D box; those that are not given have the usual level. Without given noise levels only their
/// ratios count where residuals contradict them.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Box3dSd {
    /// Of the center along the ray, relative to its distance; usually 0.1.
    pub distance: Option<f64>,
    /// Of the direction of the center, each way, radians; usually 0.02.
    pub direction: Option<f64>,
    /// Of the logarithm of an extent; usually 0.1.
    pub size: Option<f64>,
    /// Of the rotation about each axis, radians; usually 0.15.
    pub rotation: Option<f64>,
}

/// Why a cue is rejected.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum CueError {
    /// A depth that is not positive, or not finite.
    #[error("the depth is {0}; expected a positive number (world units, along the optical axis)")]
    Depth(f64),
    /// A standard deviation that is not positive, or not finite.
    #[error("the standard deviation is {0}; expected a positive number")]
    Sd(f64),
    /// A center at or behind the camera, or not finite.
    #[error(
        "the center {0:?} is not in front of the camera; expected a positive third coordinate (x to the right, y down, z \
         forwards)"
    )]
    BehindCamera([f64; 3]),
    /// Half extents that are not positive, or not finite.
    #[error("the half extents are {0:?}; expected three positive numbers")]
    HalfExtents([f64; 3]),
    /// A 3D box without anything.
    #[error("the 3D box has neither a center nor half extents nor a rotation")]
    Nothing,
}

impl Cues {
    /// Whether there are none.
    pub fn is_empty(&self) -> bool {
        self.depth.is_none() && self.box3d.is_none()
    }

    /// Whether they tell how far the object is.
    pub(crate) fn tell_distance(&self) -> bool {
        self.depth.is_some() || self.have_center()
    }

    /// Whether there is a 3D box with a center, which says where the object is without a box in the image.
    pub(crate) fn have_center(&self) -> bool {
        self.box3d.is_some_and(|b| b.center.is_some())
    }

    /// Indices of their sources.
    pub(crate) fn sources(&self) -> impl Iterator<Item = u32> + use<> {
        let (depth, box3d) = (self.depth.and_then(|depth| depth.source), self.box3d.and_then(|box3d| box3d.source));
        depth.into_iter().chain(box3d)
    }

    /// The same, to change them.
    pub(crate) fn sources_mut(&mut self) -> impl Iterator<Item = &mut u32> {
        let depth = self.depth.as_mut().and_then(|depth| depth.source.as_mut());
        depth.into_iter().chain(self.box3d.as_mut().and_then(|box3d| box3d.source.as_mut()))
    }

    /// The same cues in a world whose lengths are `factor` times as large.
    #[must_use]
    pub fn scaled(&self, factor: f64) -> Self {
        Self {
            depth: self.depth.map(|depth| DepthCue {
                median: depth.median * factor,
                sd: depth.sd.map(|sd| sd * factor),
                ..depth
            }),
            // The standard deviations of a 3D box are relative.
            box3d: self.box3d.map(|box3d| Box3dCue {
                center: box3d.center.map(|center| center * factor),
                half_extents: box3d.half_extents.map(|half| half * factor),
                ..box3d
            }),
        }
    }

    /// Checks every number.
    ///
    /// # Errors
    /// [`CueError`] names the first number that is out of range.
    pub fn check(&self) -> Result<(), CueError> {
        let positive = |x: f64| x > 0.0 && x.is_finite();
        let check_sd = |sd: Option<f64>| match sd {
            Some(sd) if !positive(sd) => Err(CueError::Sd(sd)),
            _ => Ok(()),
        };
        if let Some(depth) = &self.depth {
            if !positive(depth.median) {
                return Err(CueError::Depth(depth.median));
            }
            check_sd(depth.sd)?;
        }
        let Some(box3d) = &self.box3d else { return Ok(()) };
        if box3d.center.is_none() && box3d.half_extents.is_none() && box3d.rotation.is_none() {
            return Err(CueError::Nothing);
        }
        if let Some(center) = box3d.center.filter(|c| !(positive(c.z) && c.iter().all(|x| x.is_finite()))) {
            return Err(CueError::BehindCamera(center.into()));
        }
        if let Some(half_extents) = box3d.half_extents.filter(|h| !h.iter().all(|x| positive(*x))) {
            return Err(CueError::HalfExtents(half_extents.into()));
        }
        let Box3dSd { distance, direction, size, rotation } = box3d.sd;
        [distance, direction, size, rotation].into_iter().try_for_each(check_sd)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_out_of_range_are_named() {
        let depth = |median, sd| Cues { depth: Some(DepthCue { median, sd, source: None }), box3d: None };
        assert_eq!(depth(3.0, Some(0.1)).check(), Ok(()));
        assert_eq!(depth(-3.0, None).check(), Err(CueError::Depth(-3.0)));
        assert_eq!(depth(3.0, Some(0.0)).check(), Err(CueError::Sd(0.0)));
        let of = |box3d| Cues { depth: None, box3d: Some(box3d) }.check();
        let center = Some(Point3::new(0.0, 0.0, 5.0));
        assert_eq!(of(Box3dCue::default()), Err(CueError::Nothing));
        assert_eq!(of(Box3dCue { center, ..Default::default() }), Ok(()));
        let behind = Some(Point3::new(0.0, 0.0, -5.0));
        assert!(matches!(of(Box3dCue { center: behind, ..Default::default() }), Err(CueError::BehindCamera(_))));
        let half_extents = Some(Vector3::new(1.0, 0.0, 1.0));
        assert!(matches!(of(Box3dCue { half_extents, ..Default::default() }), Err(CueError::HalfExtents(_))));
        let sd = Box3dSd { size: Some(f64::NAN), ..Default::default() };
        assert!(matches!(of(Box3dCue { center, sd, ..Default::default() }), Err(CueError::Sd(_))));
    }
}

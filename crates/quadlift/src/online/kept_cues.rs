//! The depth and the 3D box of a kept view as plain numbers, in the frame of its camera.

use nalgebra::{Point3, Vector3};

use crate::geometry::{quaternion_from_rotation, rotation_from_quaternion};
use crate::scene::{Box3dCue, Box3dSd, Cues, DepthCue};

/// Cues of a view; see [`Cues`]. Sources are indices into those of the map.
#[derive(Debug, Clone, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub(super) struct KeptCues {
    depth: Option<KeptDepth>,
    box3d: Option<KeptBox>,
}

#[derive(Debug, Clone, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
struct KeptDepth {
    median: f64,
    sd: Option<f64>,
    source: Option<u32>,
}

#[derive(Debug, Clone, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
struct KeptBox {
    center: Option<[f64; 3]>,
    half_extents: Option<[f64; 3]>,
    /// Unit quaternion, w first.
    rotation: Option<[f64; 4]>,
    /// Of distance, direction, size and rotation.
    sd: [Option<f64>; 4],
    source: Option<u32>,
}

impl KeptCues {
    /// The cues of a detection, with the sources of the map for its own.
    pub(super) fn of(cues: &Cues, mut source_of: impl FnMut(u32) -> u32) -> Self {
        let mut source_of = |source: Option<u32>| source.map(&mut source_of);
        let Cues { depth, box3d } = cues;
        Self {
            depth: depth.map(|DepthCue { median, sd, source }| KeptDepth { median, sd, source: source_of(source) }),
            box3d: box3d.map(|Box3dCue { center, half_extents, rotation, sd, source }| {
                let Box3dSd { distance, direction, size, rotation: turn } = sd;
                KeptBox {
                    center: center.map(Into::into),
                    half_extents: half_extents.map(Into::into),
                    rotation: rotation.as_ref().map(quaternion_from_rotation),
                    sd: [distance, direction, size, turn],
                    source: source_of(source),
                }
            }),
        }
    }

    /// The cues of the detection.
    pub(super) fn to_cues(&self) -> Cues {
        let depth = |&KeptDepth { median, sd, source }: &KeptDepth| DepthCue { median, sd, source };
        let box3d = |kept: &KeptBox| {
            let [distance, direction, size, rotation] = kept.sd;
            Box3dCue {
                center: kept.center.map(Point3::from),
                half_extents: kept.half_extents.map(Vector3::from),
                rotation: kept.rotation.and_then(rotation_from_quaternion),
                sd: Box3dSd { distance, direction, size, rotation },
                source: kept.source,
            }
        };
        Cues { depth: self.depth.as_ref().map(depth), box3d: self.box3d.as_ref().map(box3d) }
    }

    /// Whether all numbers are in their ranges, in a map of so many sources.
    pub(super) fn is_valid(&self, sources: usize) -> bool {
        let is_known = |source: Option<u32>| source.is_none_or(|source| (source as usize) < sources);
        let depth_source = self.depth.as_ref().and_then(|depth| depth.source);
        let rotation = self.box3d.as_ref().and_then(|kept| kept.rotation);
        is_known(depth_source)
            && is_known(self.box3d.as_ref().and_then(|kept| kept.source))
            && rotation.is_none_or(|wxyz| rotation_from_quaternion(wxyz).is_some())
            && self.to_cues().check().is_ok()
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::Rotation3;

    use super::*;

    #[test]
    fn states_with_wrong_cues_are_not_valid() {
        let depth = DepthCue { median: 2.0, sd: Some(0.1), source: Some(1) };
        let box3d = Box3dCue {
            center: Some(Point3::new(0.1, 0.2, 5.0)),
            half_extents: Some(Vector3::new(1.0, 2.0, 3.0)),
            rotation: Some(Rotation3::from_euler_angles(0.1, 0.2, 0.3)),
            sd: Box3dSd { size: Some(0.2), ..Default::default() },
            source: Some(0),
        };
        // Numbers of the map for those of the detection.
        let kept = KeptCues::of(&Cues { depth: Some(depth), box3d: Some(box3d) }, |source| 3 - source);
        let again = kept.to_cues();
        assert_eq!(again.depth, Some(DepthCue { source: Some(2), ..depth }));
        assert_eq!(
            again.box3d.map(|b| (b.center, b.half_extents, b.sd, b.source)),
            Some((box3d.center, box3d.half_extents, box3d.sd, Some(3)))
        );
        assert!(kept.is_valid(4) && !kept.is_valid(3));
        let with = |change: &dyn Fn(&mut KeptCues)| {
            let mut kept = kept.clone();
            change(&mut kept);
            kept.is_valid(4)
        };
        assert!(!with(&|kept| kept.depth.as_mut().unwrap().median = f64::NAN));
        assert!(!with(&|kept| kept.box3d.as_mut().unwrap().rotation = Some([1.0; 4])));
        assert!(!with(&|kept| kept.box3d.as_mut().unwrap().center = Some([0.0, 0.0, -1.0])));
        assert!(!with(&|kept| kept.box3d.as_mut().unwrap().sd[0] = Some(0.0)));
    }
}

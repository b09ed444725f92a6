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
    pub fn of(cues: &Cues, mut source_of: impl FnMut(u32) -> u32) -> Self {
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
    pub fn to_cues(&self) -> Cues {
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
    pub fn is_valid(&self, sources: usize) -> bool {
        let is_known = |source: Option<u32>| source.is_none_or(|source| (source as usize) < sources);
        let depth_source = self.depth.as_ref().and_then(|depth| depth.source);
        let rotation = self.box3d.as_ref().and_then(|kept| kept.rotation);
        is_known(depth_source)
            && is_known(self.box3d.as_ref().and_then(|kept| kept.source))
            && rotation.is_none_or(|wxyz| rotation_from_quaternion(wxyz).is_some())
            && self.to_cues().check().is_ok()
    }
}

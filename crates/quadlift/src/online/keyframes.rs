//! Frames that the views of objects refer to.

use std::collections::BTreeMap;

use nalgebra::{Vector2, Vector3};

use super::input::Frame;
use crate::association::input::observations::Camera;
use crate::geometry::Projection;

/// A frame that kept views refer to, or a recent one.
#[derive(Debug, Clone)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub(super) struct Keyframe {
    pub frame: Frame,
    /// The image size, or what replaces it.
    extent: Vector2<f64>,
    /// Follows from the others, as the number of references does.
    #[cfg_attr(feature = "serde", serde(skip))]
    pub camera: Camera,
    /// Shift of its boxes relative to the map, pixels; subtracted from them.
    pub shift: Vector2<f64>,
    /// Number of references.
    #[cfg_attr(feature = "serde", serde(skip))]
    pub references: u32,
}

impl Keyframe {
    /// The frame in a map with this origin; `extent` replaces an unknown image size.
    pub(super) fn new(frame: Frame, origin: &Vector3<f64>, extent: Vector2<f64>) -> Self {
        let camera = Self::camera_of(&frame, origin, extent);
        Self { frame, extent: camera.size, camera, shift: Vector2::zeros(), references: 0 }
    }

    /// Gives the frame another pose.
    pub(super) fn set_pose(&mut self, projection: Projection, origin: &Vector3<f64>) {
        self.frame.projection = projection;
        self.camera = Self::camera_of(&self.frame, origin, self.extent);
        // The shift has stood for the error of the old pose.
        self.shift = Vector2::zeros();
    }

    /// The camera of a frame in such a map.
    pub(super) fn camera_of(frame: &Frame, origin: &Vector3<f64>, extent: Vector2<f64>) -> Camera {
        let center = frame.projection.center_in_world().map_or(*origin, |c| c.coords);
        Camera::new(&frame.projection, &center, origin, frame.image_size.unwrap_or(extent))
    }
}

/// Frames by keys that grow with time.
#[derive(Debug, Clone, Default)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub(super) struct Keyframes {
    /// Boxed: half of the places of the tree's nodes are empty, because keys only grow.
    by_key: BTreeMap<u32, Box<Keyframe>>,
}

impl Keyframes {
    pub(super) fn insert(&mut self, key: u32, keyframe: Keyframe) {
        self.by_key.insert(key, Box::new(keyframe));
    }

    pub(super) fn get(&self, key: u32) -> Option<&Keyframe> {
        self.by_key.get(&key).map(AsRef::as_ref)
    }

    pub(super) fn get_mut(&mut self, key: u32) -> Option<&mut Keyframe> {
        self.by_key.get_mut(&key).map(AsMut::as_mut)
    }

    pub(super) fn camera(&self, key: u32) -> Option<&Camera> {
        self.by_key.get(&key).map(|k| &k.camera)
    }

    pub(super) fn iter(&self) -> impl Iterator<Item = (u32, &Keyframe)> {
        self.by_key.iter().map(|(&key, keyframe)| (key, keyframe.as_ref()))
    }

    pub(super) fn len(&self) -> usize {
        self.by_key.len()
    }

    /// Adds a reference; false if there is no such frame.
    pub(super) fn hold(&mut self, key: u32) -> bool {
        self.by_key.get_mut(&key).map(|keyframe| keyframe.references += 1).is_some()
    }

    /// Computes the cameras and counts the references of stored frames anew; `None` where a frame is missing or not finite.
    #[cfg(feature = "serde")]
    pub(super) fn rebuild(&mut self, origin: &Vector3<f64>, held: impl Iterator<Item = u32>) -> Option<()> {
        for keyframe in self.by_key.values_mut() {
            let is_finite = keyframe.extent.iter().chain(&keyframe.shift).all(|x| x.is_finite());
            keyframe.camera = is_finite.then(|| Keyframe::camera_of(&keyframe.frame, origin, keyframe.extent))?;
            keyframe.references = 0;
        }
        for key in held {
            self.hold(key).then_some(())?;
        }
        self.by_key.retain(|_, keyframe| keyframe.references > 0);
        Some(())
    }

    /// The largest key.
    #[cfg(feature = "serde")]
    pub(super) fn last_key(&self) -> Option<u32> {
        self.by_key.keys().next_back().copied()
    }

    /// Removes a reference; a frame without references is removed.
    pub(super) fn release(&mut self, key: u32) {
        if let Some(keyframe) = self.by_key.get_mut(&key) {
            keyframe.references = keyframe.references.saturating_sub(1);
            if keyframe.references == 0 {
                self.by_key.remove(&key);
            }
        }
    }
}

//! Frames that the views of objects refer to.

use std::collections::BTreeMap;

use nalgebra::{Vector2, Vector3};

use super::input::Frame;
use crate::association::input::observations::Camera;

/// A frame that kept views refer to, or a recent one.
#[derive(Debug, Clone)]
pub(super) struct Keyframe {
    pub frame: Frame,
    pub camera: Camera,
    /// Shift of its boxes relative to the map, pixels; subtracted from them.
    pub shift: Vector2<f64>,
    /// Number of references.
    pub references: u32,
}

impl Keyframe {
    /// The frame in a map with this origin; `extent` replaces an unknown image size.
    pub(super) fn new(frame: Frame, origin: &Vector3<f64>, extent: Vector2<f64>) -> Self {
        let camera = Self::camera_of(&frame, origin, extent);
        Self { frame, camera, shift: Vector2::zeros(), references: 0 }
    }

    /// The camera of a frame in such a map.
    pub(super) fn camera_of(frame: &Frame, origin: &Vector3<f64>, extent: Vector2<f64>) -> Camera {
        let center = frame.projection.center_in_world().map_or(*origin, |c| c.coords);
        Camera::new(&frame.projection, &center, origin, frame.image_size.unwrap_or(extent))
    }
}

/// Frames by keys that grow with time.
#[derive(Debug, Clone, Default)]
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

    /// Adds a reference.
    pub(super) fn hold(&mut self, key: u32) {
        if let Some(keyframe) = self.by_key.get_mut(&key) {
            keyframe.references += 1;
        }
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

//! Priors of one object: shape, size of its category, upright stance, ground plane.

use nalgebra::Vector3;

use super::learnt_size::LearntSize;
use super::size_site::SizeSite;
use crate::body_model::{BodyModel, descending};
use crate::scene::ObjectViews;
use crate::solve::conditioning::ObjectFrame;
use crate::solve::map::context::MapContext;
use crate::solve::options::BodyKind;

/// Standard deviation of the tilt of an object that stands, radians (3 degrees): of the object, and of `up` itself.
pub(crate) const TILT_SD: f64 = 0.05;

/// Priors of one object, in its frame.
#[derive(Debug, Clone, Default)]
pub(crate) struct ObjectPrior {
    /// 1/sd of the deviation of the log semi-axes from their mean.
    pub shape_weight: f64,
    /// Mean and 1/sd of the log semi-axes: length, width, height.
    pub log_size: Option<[(f64, f64); 3]>,
    /// The size learnt from the other objects of the category, in the place of the shape prior: of an oriented body, of an ellipsoid.
    pub learnt_size: Option<LearntSize>,
    pub size_site: Option<SizeSite>,
    /// Direction against gravity, in the frame.
    pub up: Option<Vector3<f64>>,
    /// 1/sd of the angle between an axis and `up`.
    pub upright_weight: f64,
    /// Whether the object stands on the ground plane.
    pub on_ground: bool,
    /// The axes of the body model are length, width and height, in this order (set for oriented bodies).
    pub axes_are_named: bool,
}

impl ObjectPrior {
    /// For each axis of the body, which of length (0), width (1) and height (2) it is.
    pub(crate) fn named_axes(&self, body: &impl BodyModel) -> [usize; 3] {
        if self.axes_are_named {
            return [0, 1, 2];
        }
        let semi_axes = body.semi_axes();
        let mut names = [0; 3];
        match &self.up {
            Some(up) => {
                let vertical = (body.axes().transpose() * up).iamax();
                let (a, b) = ((vertical + 1) % 3, (vertical + 2) % 3);
                let length = if semi_axes[a] >= semi_axes[b] { a } else { b };
                names[vertical] = 2;
                names[length] = 0;
                names[3 - vertical - length] = 1;
            }
            None => {
                // Longest to longest: the only sensible match when no direction is known.
                let by_prior = descending(&self.log_size.unwrap_or_default().map(|(mean, _)| mean).into());
                for (axis, name) in descending(&semi_axes).into_iter().zip(by_prior) {
                    names[axis] = name;
                }
            }
        }
        names
    }
}

/// The priors of an object in its frame.
pub(crate) fn object_prior(
    views: &ObjectViews,
    frame: &ObjectFrame,
    kind: BodyKind,
    context: &MapContext,
) -> ObjectPrior {
    let mut prior = ObjectPrior { shape_weight: 1.0 / context.options.shape_sd, ..Default::default() };
    prior.axes_are_named = kind != BodyKind::Ellipsoid;
    let name = views.category_index.map_or("", |index| context.categories[index].as_str());
    prior.on_ground = context.options.ground_plane && context.up.is_some();
    let Some(category) = context.options.priors.of(name) else { return prior };
    prior.on_ground |= category.on_ground && context.up.is_some();
    if let (Some(up), Some(sd)) = (context.up, category.upright_sd) {
        prior.up = Some(frame.direction_from_world(&up));
        prior.upright_weight = 1.0 / sd;
    }
    if let Some(size) = category.size {
        prior.log_size =
            Some(std::array::from_fn(|k| ((0.5 * size.mean[k] / frame.unit).ln(), size.mean[k] / size.sd[k])));
        if prior.up.is_none() {
            prior.up = context.up.map(|up| frame.direction_from_world(&up));
        }
        // The category's size takes the place of the general shape prior.
        prior.shape_weight = 0.0;
    }
    prior
}

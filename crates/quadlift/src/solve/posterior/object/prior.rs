//! Priors of one object: shape, size of its category, upright stance, ground plane.

use nalgebra::{Matrix3, Vector3};

use super::size_site::SizeSite;
use crate::body_model::{BodyModel, descending};
use crate::geometry::BodyKind;
use crate::geometry::linalg::{cholesky, invert_spd};
use crate::optimize::normal_equations::{NormalEquations, Row};
use crate::optimize::student_t::StudentT;
use crate::scene::ObjectViews;
use crate::solve::conditioning::ObjectFrame;
use crate::solve::posterior::context::PosteriorContext;
use crate::solve::posterior::shared::size_model::{SizeDistribution, first_order, orders};

/// Standard deviation of the tilt of an object that stands, radians (3 degrees): of the object, and of `up` itself.
pub(crate) const TILT_SD: f64 = 0.05;

/// Priors of one object, in its frame.
#[derive(Debug, Clone, Default)]
pub(crate) struct ObjectPrior {
    /// 1/sd of the deviation of the log semi-axes from their mean.
    pub shape_weight: f64,
    /// Mean and 1/sd of the log semi-axes: length, width, height.
    pub log_size: Option<[(f64, f64); 3]>,
    /// The size learned from the other objects of the category, in the place of the shape prior: of an oriented body, of an ellipsoid.
    pub learned_size: Option<LearnedSize>,
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

/// A learned size as a prior of an oriented body, in an object's frame.
#[derive(Debug, Clone)]
pub(crate) struct LearnedSize {
    /// Logarithms of the half extents, object units.
    mean: Vector3<f64>,
    /// W with W^T W the inverse of the covariance.
    root: Matrix3<f64>,
    loss: StudentT,
    /// How much it counts, like the measurements ([`super::fit::Fit::with_learned_size`]).
    factor: f64,
    /// Direction against gravity, if the third axis is the vertical one.
    up: Option<Vector3<f64>>,
}

impl LearnedSize {
    /// In object units; `None` where the covariance is singular.
    pub(crate) fn new(size: &SizeDistribution, up: Option<Vector3<f64>>, factor: f64) -> Option<Self> {
        let root = cholesky(&invert_spd(&size.covariance)?)?.transpose();
        Some(Self { mean: size.mean, root, loss: StudentT::new(size.dof), factor, up })
    }

    /// For each name (length, width, height) the axis of a body that has it: the order that suits best, with its whitened
    /// residuals.
    fn named_axes(&self, body: &impl BodyModel) -> ([usize; 3], Vector3<f64>) {
        let log = body.semi_axes().map(f64::ln);
        let first = first_order(&log, body.axes(), self.up.as_ref());
        let mut best = (f64::INFINITY, first, Vector3::zeros());
        for order in orders(self.up.is_some()) {
            let axes = order.map(|k| first[k]);
            let residuals = self.root * (Vector3::from(axes.map(|axis| log[axis])) - self.mean);
            if residuals.norm_squared() < best.0 {
                best = (residuals.norm_squared(), axes, residuals);
            }
        }
        (best.1, best.2)
    }

    /// Adds the prior to the objective.
    pub(crate) fn add_to(&self, body: &impl BodyModel, equations: &mut NormalEquations) {
        let gradients = body.log_axes_gradient();
        let (axes, residuals) = self.named_axes(body);
        let squares = residuals.norm_squared();
        let weight = self.loss.weight_of(squares, 3) * self.factor;
        equations.cost += self.loss.cost_of(squares, 3) * self.factor;
        for i in 0..3 {
            let row: Row = std::array::from_fn(|p| (0..3).map(|k| self.root[(i, k)] * gradients[axes[k]][p]).sum());
            equations.add_row(residuals[i], &row, weight);
        }
        body.add_spin_prior(equations);
    }

    /// The precision of the logarithms of the semi-axes at a body, and that times their mean.
    pub(super) fn precision(&self, body: &impl BodyModel) -> (Matrix3<f64>, Vector3<f64>) {
        let (axes, residuals) = self.named_axes(body);
        let named =
            self.root.transpose() * self.root * (self.loss.weight_of(residuals.norm_squared(), 3) * self.factor);
        let (mut precision, mut mean) = (Matrix3::zeros(), Vector3::zeros());
        for i in 0..3 {
            mean[axes[i]] = self.mean[i];
            for j in 0..3 {
                precision[(axes[i], axes[j])] = named[(i, j)];
            }
        }
        (precision, precision * mean)
    }
}

/// The priors of an object in its frame.
pub(crate) fn object_prior(
    views: &ObjectViews,
    frame: &ObjectFrame,
    kind: BodyKind,
    context: &PosteriorContext,
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

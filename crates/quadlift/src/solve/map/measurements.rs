//! One object's detections, prepared for the solver: tangent planes and ellipses in the object's frame.

use std::borrow::Cow;
use std::ops::Range;

use nalgebra::{Matrix3x4, Vector2, Vector3, Vector4};

use super::super::conditioning::ObjectFrame;
use super::super::planes::{BORDER_TOLERANCE_PX, edge_plane, edges_at_border};
use super::ellipse_residual::EllipseMeasurement;
use crate::geometry::Ellipse;
use crate::scene::View;

/// A tangent plane `n.x + d = 0`, positive on the side of the body, divided by the detection's half size in pixels:
/// `(n.t + d - h(n)) / depth` is then the edge's error in half sizes.
#[derive(Debug, Clone, Copy)]
pub(super) struct Plane {
    pub n: Vector3<f64>,
    pub d: f64,
}

impl Plane {
    fn new(plane: Vector4<f64>) -> Self {
        Self { n: plane.xyz(), d: plane.w }
    }
}

/// An edge whose partner on the other side of the box is not a plain measurement.
#[derive(Debug, Clone, Copy)]
pub(super) struct SingleEdge {
    pub plane: Plane,
    /// At the image border the object is cut off: the edge tells only that the body reaches at least so far.
    pub one_sided: bool,
}

/// What one view measured; ranges index into [`Measurements`].
#[derive(Debug, Clone)]
pub(super) struct MeasuredView {
    /// Unit viewing axis: the depth of a point is `axis.x + offset`.
    pub axis: Vector3<f64>,
    pub offset: f64,
    pub pairs: Range<usize>,
    pub singles: Range<usize>,
    pub ellipse: Option<EllipseMeasurement>,
}

/// All measurements of an object.
#[derive(Debug, Clone)]
pub(super) struct Measurements {
    pub frame: ObjectFrame,
    pub views: Vec<MeasuredView>,
    /// Opposite tangent planes.
    pub pairs: Vec<[Plane; 2]>,
    pub singles: Vec<SingleEdge>,
}

/// Directions in which the tangent lines of an ellipse are taken for bodies whose outline is no ellipse.
const TANGENT_DIRECTIONS: usize = 4;

impl Measurements {
    /// Prepares the views. `ellipses_as_planes` replaces every ellipse by tangent lines in four directions;
    /// `border_margin` is the share of the image's larger side within which an edge counts as cut off.
    pub(super) fn new(frame: ObjectFrame, views: &[View], ellipses_as_planes: bool, border_margin: f64) -> Self {
        let mut all = Self {
            frame,
            views: Vec::with_capacity(views.len()),
            pairs: Vec::with_capacity(2 * views.len()),
            singles: Vec::new(),
        };
        for view in views {
            all.push(view, ellipses_as_planes, border_margin);
        }
        all
    }

    /// The same views as tangent planes only.
    pub(super) fn with_ellipses_as_planes(&self, views: &[View]) -> Cow<'_, Self> {
        if self.views.iter().all(|view| view.ellipse.is_none()) {
            return Cow::Borrowed(self);
        }
        Cow::Owned(Self::new(self.frame, views, true, 0.0))
    }

    fn push(&mut self, view: &View, ellipses_as_planes: bool, border_margin: f64) {
        let p = self.frame.local_projection(&view.projection);
        let (first_pair, first_single) = (self.pairs.len(), self.singles.len());
        let mut ellipse = None;
        match (&view.ellipse, &view.bounding_box) {
            (Some(observed), _) if ellipses_as_planes => self.push_tangents(&p, observed),
            (Some(observed), _) => ellipse = Some(EllipseMeasurement::new(&p, observed)),
            (None, Some(bounding_box)) => {
                let half_size = bounding_box.mean_half_size();
                let margin = view.image_size.map_or(0.0, |s| border_margin * s.max()).max(BORDER_TOLERANCE_PX);
                let cut = edges_at_border(bounding_box, view.image_size, margin);
                let plane = |edge| Plane::new(edge_plane(&p, bounding_box, edge) / half_size);
                for (a, b) in [(0, 2), (1, 3)] {
                    if cut[a] || cut[b] {
                        for edge in [a, b] {
                            self.singles.push(SingleEdge { plane: plane(edge), one_sided: cut[edge] });
                        }
                    } else {
                        self.pairs.push([plane(a), plane(b)]);
                    }
                }
            }
            (None, None) => {}
        }
        self.views.push(MeasuredView {
            axis: Vector3::new(p[(2, 0)], p[(2, 1)], p[(2, 2)]),
            offset: p[(2, 3)],
            pairs: first_pair..self.pairs.len(),
            singles: first_single..self.singles.len(),
            ellipse,
        });
    }

    fn push_tangents(&mut self, p: &Matrix3x4<f64>, ellipse: &Ellipse) {
        let half_size = ellipse.semi_axes.mean();
        for k in 0..TANGENT_DIRECTIONS {
            let (sin, cos) = (std::f64::consts::PI * k as f64 / TANGENT_DIRECTIONS as f64).sin_cos();
            let normal = Vector2::new(cos, sin);
            self.pairs.push([-normal, normal].map(|n| {
                let line = ellipse.tangent_line(&n);
                Plane::new(-(p.transpose() * Vector3::from(line)) / half_size)
            }));
        }
    }
}

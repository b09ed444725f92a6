//! One object's detections, prepared for the solver: tangent planes and ellipses in the object's frame.

use std::borrow::Cow;
use std::ops::Range;

use nalgebra::{Matrix3x4, Vector3, Vector4};

use super::cues::MeasuredCue;
use super::ellipse::EllipseMeasurement;
use crate::body_model::BodyModel;
use crate::geometry::{Body, TangentLines, edge_plane, support_plane};
use crate::scene::View;
use crate::solve::conditioning::ObjectFrame;
use crate::solve::posterior::noise::groups::NoiseGroup;

/// A tangent plane `n.x + d = 0`, positive on the side of the body, divided by the detection's half size in pixels:
/// `(n.t + d - h(n)) / depth` is then the edge's error in half sizes.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Plane {
    pub n: Vector3<f64>,
    pub d: f64,
}

impl Plane {
    fn new(plane: Vector4<f64>) -> Self {
        Self { n: plane.xyz(), d: plane.w }
    }
}

/// A measured tangent plane.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Edge {
    pub plane: Plane,
    /// At the image border, and for lines of outlines at other objects, the object goes on unseen: the edge only bounds the extent of the
    /// body from below.
    pub one_sided: bool,
    /// Whether another box probably hides it.
    pub group: NoiseGroup,
}

/// The measurements of one view.
#[derive(Debug, Clone)]
pub(crate) struct MeasuredView {
    /// Unit viewing axis: the depth of a point is `axis.x + offset`.
    pub axis: Vector3<f64>,
    pub offset: f64,
    /// Mean half size of the box or mean semi-axis of the ellipse, in pixels.
    pub half_size: f64,
    /// Its edges in [`Measurements::edges`]: opposite ones follow each other.
    pub edges: Range<usize>,
    /// Whether they are the lines of a whole outline that may be compared by harmonics ([`super::harmonics`]).
    pub outline: bool,
    /// Whether they are: no line is far off ([`super::view_rows::choose_harmonics`]).
    pub harmonics: bool,
    pub ellipse: Option<EllipseMeasurement>,
}

/// All measurements of an object.
#[derive(Debug, Clone)]
pub(crate) struct Measurements {
    pub frame: ObjectFrame,
    pub views: Vec<MeasuredView>,
    pub edges: Vec<Edge>,
    /// Depths and 3D boxes, in the order of the views.
    pub cues: Vec<MeasuredCue>,
}

impl Measurements {
    /// Prepares the views. `ellipses_as_planes` replaces every ellipse by its tangent lines; `named` says that the axes of
    /// the body are length, width and height.
    pub(crate) fn new(frame: ObjectFrame, views: &[View], ellipses_as_planes: bool, named: bool) -> Self {
        let mut all = Self {
            frame,
            views: Vec::with_capacity(views.len()),
            edges: Vec::with_capacity(4 * views.len()),
            cues: Vec::new(),
        };
        for view in views {
            all.push(view, ellipses_as_planes, named);
        }
        all
    }

    /// The same views as tangent planes only.
    pub(crate) fn with_ellipses_as_planes(&self, views: &[View]) -> Cow<'_, Self> {
        if self.views.iter().all(|view| view.ellipse.is_none()) {
            return Cow::Borrowed(self);
        }
        Cow::Owned(Self::new(self.frame, views, true, false))
    }

    /// Whether a view has a depth, which depends on what of the body is seen.
    pub(crate) fn has_depths(&self) -> bool {
        self.cues.iter().any(MeasuredCue::is_depth)
    }

    /// Whether a view has a whole outline.
    pub(crate) fn has_outlines(&self) -> bool {
        self.views.iter().any(|view| view.outline)
    }

    /// Sees a body as perspective does ([`MeasuredCue::look_at`]).
    pub(crate) fn look_at(&mut self, body: &impl BodyModel, world: &Body, views: &[View]) {
        for cue in &mut self.cues {
            cue.look_at(body, world, &views[cue.view], &self.frame);
        }
    }

    /// Sees the body as measurements of the same views saw it.
    pub(crate) fn look_as(&mut self, other: &Self) {
        self.cues.iter_mut().zip(&other.cues).for_each(|(cue, other)| cue.look_as(other));
        self.views.iter_mut().zip(&other.views).for_each(|(view, other)| view.harmonics = other.harmonics);
    }

    fn push(&mut self, view: &View, ellipses_as_planes: bool, named: bool) {
        let p = self.frame.local_projection(&view.projection);
        if !view.cues.is_empty() {
            self.cues.extend(MeasuredCue::of_view(view, self.views.len(), &self.frame, &p, named));
        }
        let first = self.edges.len();
        let mut ellipse = None;
        if let Some(observed) = &view.ellipse {
            match view.bounding_box {
                // The box's edges stand for it.
                Some(_) if ellipses_as_planes => {}
                None if ellipses_as_planes => {
                    self.push_tangent_lines(&p, &TangentLines::of_ellipse(observed), observed.semi_axes.mean());
                }
                beside => ellipse = Some(EllipseMeasurement::new(&p, observed, beside.is_some(), view.partial)),
            }
        }
        let lines = view.tangent_lines.as_ref().filter(|_| view.bounding_box.is_some());
        if let Some(lines) = lines {
            self.push_tangent_lines(&p, lines, lines.mean_half_size());
        } else if let Some(bounding_box) = &view.bounding_box {
            let half_size = bounding_box.mean_half_size();
            for edge in [0, 2, 1, 3] {
                let plane = Plane::new(edge_plane(&p, bounding_box, edge) / half_size);
                let hidden = view.occluded_edges[edge];
                let group = if hidden { NoiseGroup::OccludedEdge } else { NoiseGroup::Edge };
                self.edges.push(Edge { plane, one_sided: view.cut_off[edge], group });
            }
        }
        self.views.push(MeasuredView {
            axis: Vector3::new(p[(2, 0)], p[(2, 1)], p[(2, 2)]),
            offset: p[(2, 3)],
            half_size: match (lines, &view.bounding_box, &view.ellipse) {
                (Some(lines), ..) => lines.mean_half_size(),
                (None, Some(bounding_box), _) => bounding_box.mean_half_size(),
                (None, None, Some(ellipse)) => ellipse.semi_axes.mean(),
                (None, None, None) => 1.0,
            },
            edges: first..self.edges.len(),
            // Other bodies than ellipsoids show in what is not smooth, too.
            outline: !ellipses_as_planes && lines.is_some_and(TangentLines::is_of_whole_outline),
            harmonics: false,
            ellipse,
        });
    }

    fn push_tangent_lines(&mut self, p: &Matrix3x4<f64>, lines: &TangentLines, half_size: f64) {
        let half = lines.count() / 2;
        for line in (0..half).flat_map(|k| [k, k + half]).map(|k| lines.line(k)) {
            let plane = Plane::new(support_plane(p, &line) / half_size);
            // What another object hides goes on unseen, as beyond the border.
            self.edges.push(Edge { plane, one_sided: line.end.is_open(), group: NoiseGroup::Edge });
        }
    }
}

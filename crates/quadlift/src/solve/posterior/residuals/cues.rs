//! Residuals of cues: the depth of the visible surface, and a 3D box (docs/method.md, section 19).
//!
//! Lengths are compared by their logarithms, so that a wrong scale of their source is a constant that is added.

use nalgebra::{Matrix3x4, Vector3};

use super::row::{MIN_DEPTH, ResidualRow};
use crate::body_model::{BodyModel, MeasuredShape};
use crate::geometry::Body;
use crate::geometry::rotation::horizontal_basis;
use crate::geometry::visible_surface::visible_depth;
use crate::optimize::normal_equations::Row;
use crate::scene::{Box3dCue, Box3dSd, Cues, DepthCue, View};
use crate::solve::conditioning::ObjectFrame;
use crate::solve::posterior::noise::groups::NoiseGroup;
use crate::solve::posterior::noise::levels::{NoiseLevels, noise_prior};

/// Rays along each side of a box in the search for the visible surface.
const RAYS: usize = 9;

/// Bound of the logarithm of the visible depth over that from afar.
const MAX_PERSPECTIVE: f64 = 0.5;

/// A cue of one view, prepared.
#[derive(Debug, Clone)]
pub(crate) struct MeasuredCue {
    /// Index of the view among those of the object.
    pub view: usize,
    kind: Kind,
}

#[derive(Debug, Clone)]
enum Kind {
    Depth(MeasuredDepth),
    Box(Box<MeasuredBox3d>),
}

/// How far the visible surface is.
#[derive(Debug, Clone)]
struct MeasuredDepth {
    /// The depth of a point is `axis.x + offset`.
    axis: Vector3<f64>,
    offset: f64,
    /// Unit direction of the ray through the middle of the detection, and its cosine with the axis.
    ray: Vector3<f64>,
    cosine: f64,
    log_depth: f64,
    /// Shift of the source: measured minus true depth, in the object's lengths.
    shift: f64,
    weight: f64,
    /// Logarithm of the median depth of the visible surface over that of [`BodyModel::near_side`], at a body near this one.
    perspective: f64,
}

/// A 3D box.
#[derive(Debug, Clone)]
struct MeasuredBox3d {
    center: Option<MeasuredCenter>,
    shape: Option<MeasuredShape>,
    /// Of the sizes, of the rotation.
    weights: [f64; 2],
}

/// The center of a 3D box.
#[derive(Debug, Clone)]
struct MeasuredCenter {
    camera: Vector3<f64>,
    /// Towards the center, and two directions across.
    ray: Vector3<f64>,
    across: [Vector3<f64>; 2],
    log_distance: f64,
    /// Of the distance, of the directions.
    weights: [f64; 2],
}

/// 1 / sd of an error, relative to the usual level of its kind.
fn weight(sd: Option<f64>, group: NoiseGroup) -> f64 {
    sd.map_or(1.0, |sd| noise_prior(group) / sd)
}

/// [`weight`] of a depth.
fn weight_of_depth(depth: &DepthCue) -> f64 {
    weight(depth.sd.map(|sd| sd / depth.median), NoiseGroup::Depth)
}

/// [`weight`] of each kind of error of these cues. Where they are all scaled by one factor, only the noise levels change.
pub(crate) fn weights(cues: Cues) -> impl Iterator<Item = (NoiseGroup, f64)> {
    let depth = cues.depth.map(|depth| (NoiseGroup::Depth, weight_of_depth(&depth)));
    let of_box = cues.box3d.map(|box3d| GROUPS_OF_BOX.into_iter().zip(weights_of_box(&box3d.sd)));
    depth.into_iter().chain(of_box.into_iter().flatten())
}

/// Kinds of errors of a 3D box.
const GROUPS_OF_BOX: [NoiseGroup; 4] =
    [NoiseGroup::BoxDistance, NoiseGroup::BoxDirection, NoiseGroup::BoxSize, NoiseGroup::BoxRotation];

/// [`weight`] of each of [`GROUPS_OF_BOX`].
fn weights_of_box(&Box3dSd { distance, direction, size, rotation }: &Box3dSd) -> [f64; 4] {
    let sds = [distance, direction, size, rotation];
    std::array::from_fn(|k| weight(sds[k], GROUPS_OF_BOX[k]))
}

impl MeasuredCue {
    /// The cues of a view, in the object's frame; `p` is its local projection. `named` says that the axes of the body are
    /// length, width and height.
    pub(crate) fn of_view(
        view: &View,
        index: usize,
        frame: &ObjectFrame,
        p: &Matrix3x4<f64>,
        named: bool,
    ) -> Vec<Self> {
        let depth = view.cues.depth.and_then(|depth| MeasuredDepth::new(&depth, view, frame, p)).map(Kind::Depth);
        let measured =
            view.cues.box3d.and_then(|b| MeasuredBox3d::new(&b, view, frame, named)).map(Box::new).map(Kind::Box);
        depth.into_iter().chain(measured).map(|kind| Self { view: index, kind }).collect()
    }

    /// Whether it is a depth.
    pub(crate) fn is_depth(&self) -> bool {
        matches!(self.kind, Kind::Depth(_))
    }

    /// Sees a body as perspective does, where its view is this one: `world` is the body in the world. The closed form of
    /// [`BodyModel::near_side`] is that of parallel rays, and a mean; a car 6 m away has a median that is up to a fifth nearer.
    pub(crate) fn look_at(&mut self, body: &impl BodyModel, world: &Body, view: &View, frame: &ObjectFrame) {
        let Kind::Depth(depth) = &mut self.kind else { return };
        let seen = view.measured_box().and_then(|b| visible_depth(&view.projection, &b, world, RAYS));
        if let (Some(seen), Some((afar, _))) = (seen, depth.depth_from_afar(body)) {
            depth.perspective = (seen / (frame.unit * afar)).ln().clamp(-MAX_PERSPECTIVE, MAX_PERSPECTIVE);
        }
    }

    /// Sees a body as another cue of the same detection saw it.
    pub(crate) fn look_as(&mut self, other: &Self) {
        if let (Kind::Depth(depth), Kind::Depth(other)) = (&mut self.kind, &other.kind) {
            depth.perspective = other.perspective;
        }
    }

    /// The depth of the visible surface of a body that this depth measures, in the object's lengths; `None` for other cues, and where it
    /// or what the shift makes of it is not before the camera.
    pub(crate) fn predicted_depth(&self, body: &impl BodyModel) -> Option<f64> {
        let Kind::Depth(measured) = &self.kind else { return None };
        let depth = measured.depth_from_afar(body)?.0 * measured.perspective.exp();
        Some(depth).filter(|depth| depth + measured.shift > MIN_DEPTH)
    }

    /// 1 / standard deviation of the errors of a group in this cue.
    pub(crate) fn whitening(&self, noise: &NoiseLevels, group: NoiseGroup) -> f64 {
        let weight = match (&self.kind, group) {
            (Kind::Depth(depth), _) => depth.weight,
            (Kind::Box(measured), NoiseGroup::BoxSize) => measured.weights[0],
            (Kind::Box(measured), NoiseGroup::BoxRotation) => measured.weights[1],
            (Kind::Box(measured), NoiseGroup::BoxDistance) => measured.center.as_ref().map_or(1.0, |c| c.weights[0]),
            (Kind::Box(measured), _) => measured.center.as_ref().map_or(1.0, |c| c.weights[1]),
        };
        weight / noise.of(group)
    }

    /// Fills `rows` with the whitened residuals of the cue.
    pub(crate) fn rows(&self, body: &impl BodyModel, noise: &NoiseLevels, rows: &mut Vec<ResidualRow>) {
        rows.clear();
        let mut push = |(residual, row): (f64, Row), group: NoiseGroup| {
            let weight = self.whitening(noise, group);
            rows.push(ResidualRow { residual: residual * weight, row: row.map(|x| x * weight), group, counts: true });
        };
        match &self.kind {
            Kind::Depth(depth) => push(depth.residual(body), NoiseGroup::Depth),
            Kind::Box(measured) => {
                if let Some(center) = &measured.center {
                    let [distance, across @ ..] = center.residuals(body);
                    push(distance, NoiseGroup::BoxDistance);
                    across.into_iter().for_each(|row| push(row, NoiseGroup::BoxDirection));
                }
                if let Some(shape) = &measured.shape {
                    let difference = body.compare(shape);
                    difference.size.into_iter().flatten().for_each(|row| push(row, NoiseGroup::BoxSize));
                    difference.rotation.into_iter().flatten().for_each(|row| push(row, NoiseGroup::BoxRotation));
                }
            }
        }
    }
}

impl MeasuredDepth {
    fn new(depth: &DepthCue, view: &View, frame: &ObjectFrame, p: &Matrix3x4<f64>) -> Option<Self> {
        let ray = view.projection.ray_in_world(&view.measured_box()?.center())?;
        let ray = frame.direction_from_world(&ray);
        let axis = Vector3::new(p[(2, 0)], p[(2, 1)], p[(2, 2)]);
        Some(Self {
            axis,
            offset: p[(2, 3)],
            ray,
            cosine: axis.dot(&ray),
            log_depth: (depth.median / frame.unit).ln(),
            shift: view.depth_shift / frame.unit,
            weight: weight_of_depth(depth),
            perspective: 0.0,
        })
    }

    /// The depth of the visible surface seen from afar, and its derivatives.
    fn depth_from_afar(&self, body: &impl BodyModel) -> Option<(f64, Row)> {
        let (near, slope) = body.near_side(&self.ray);
        let depth = self.axis.dot(body.center()) + self.offset - self.cosine * near;
        let row = std::array::from_fn(|k| if k < 3 { self.axis[k] } else { -self.cosine * slope[k - 3] });
        (depth > MIN_DEPTH).then_some((depth, row))
    }

    /// Logarithm of the measured depth over that of the visible surface with the shift.
    fn residual(&self, body: &impl BodyModel) -> (f64, Row) {
        let shifted = |(depth, row): (f64, Row)| (depth + self.shift * (-self.perspective).exp(), row);
        match self.depth_from_afar(body).map(shifted) {
            Some((depth, row)) if depth > MIN_DEPTH => {
                (self.log_depth - depth.ln() - self.perspective, row.map(|x| -x / depth))
            }
            _ => (self.log_depth - MIN_DEPTH.ln(), [0.0; 9]),
        }
    }
}

impl MeasuredBox3d {
    fn new(measured: &Box3dCue, view: &View, frame: &ObjectFrame, named: bool) -> Option<Self> {
        let frame_from_cam = frame.axes.tr_mul(&view.projection.world_from_cam_rotation()?);
        let [distance, direction, size, rotation] = weights_of_box(&measured.sd);
        let center = match measured.center {
            Some(center) => {
                let camera = frame.point_from_world(&view.projection.center_in_world()?);
                let offset = frame_from_cam * center.coords / frame.unit;
                let ray = nalgebra::Unit::try_new(offset, 0.0)?;
                Some(MeasuredCenter {
                    camera,
                    ray: *ray,
                    across: horizontal_basis(&ray),
                    log_distance: offset.norm().ln(),
                    weights: [distance, direction],
                })
            }
            None => None,
        };
        let shape = MeasuredShape {
            axes: measured.rotation.map(|rotation| frame_from_cam * rotation.matrix()),
            log_half_extents: measured.half_extents.map(|half| half.map(|x| (x / frame.unit).ln())),
            named,
        };
        let shape = (shape.axes.is_some() || shape.log_half_extents.is_some()).then_some(shape);
        Some(Self { center, shape, weights: [size, rotation] })
    }
}

impl MeasuredCenter {
    /// Logarithm of the measured distance over the predicted one (along the measured ray), and two angles.
    fn residuals(&self, body: &impl BodyModel) -> [(f64, Row); 3] {
        let from_camera = body.center() - self.camera;
        let along = from_camera.dot(&self.ray);
        if along <= MIN_DEPTH {
            return [(self.log_distance - MIN_DEPTH.ln(), [0.0; 9]); 3];
        }
        let row = |by_center: Vector3<f64>| std::array::from_fn(|k| if k < 3 { by_center[k] } else { 0.0 });
        let distance = (self.log_distance - along.ln(), row(-self.ray / along));
        let [a, b] = self.across.map(|across| {
            let angle = across.dot(&from_camera) / along;
            (-angle, row((self.ray * angle - across) / along))
        });
        [distance, a, b]
    }
}

//! What is estimated together: cameras, the vertical, shapes, and a position for each object and time step.

use nalgebra::Vector3;

use super::predicted::{Predicted, Shape, across};
use crate::geometry::rigid::Pose;
use crate::optimize::student_t::StudentT;

/// Degrees of freedom of the Student t distribution of residuals, as of `posterior`.
const DOF: f64 = 9.0;

/// The distribution of whitened residuals.
pub(super) const STUDENT_T: StudentT = StudentT::new(DOF);

/// Part of the error of an edge that does not depend on the size of the box, pixels.
const EDGE_PX: f64 = 1.0;

/// Standard deviation of the width of bodies, relative to the mean half size of their boxes, as an edge has it.
const WIDTH_SD: f64 = 0.4;

/// A box, in coordinates (X / Z, Y / Z) of its camera.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct MeasuredBox {
    /// Left, top, right, bottom.
    pub edges: [f64; 4],
    /// Whether the image ends there.
    pub cut_off: [bool; 4],
    /// Mean half size of the box, and a pixel, along both axes.
    pub size: [f64; 2],
    pub pixel: [f64; 2],
}

impl MeasuredBox {
    pub(super) fn center(&self) -> [f64; 2] {
        [0, 1].map(|axis| 0.5 * (self.edges[axis] + self.edges[axis + 2]))
    }

    pub(super) fn half_size(&self) -> [f64; 2] {
        [0, 1].map(|axis| 0.5 * (self.edges[axis + 2] - self.edges[axis]))
    }

    pub(super) fn is_whole(&self) -> bool {
        !self.cut_off.contains(&true)
    }
}

/// Noise of the boxes of a category, each relative to the mean half size and as the standard deviation of an edge: of centers and of
/// heights.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Levels(pub [f64; 2]);

impl Levels {
    fn times(self, factor: f64) -> Self {
        Self(self.0.map(|level| level * factor))
    }
}

/// A residual of a box: a combination of its edges.
#[derive(Debug, Clone, Copy)]
pub(super) struct BoxRow {
    /// Coefficients of the predicted edges, whitened.
    pub of_edges: [f64; 4],
    /// Predicted less measured, whitened.
    pub residual: f64,
    /// The level of [`Levels`] that it tells about; one edge alone tells about none.
    pub level: Option<usize>,
}

/// The residuals of a box: its center and its height, or single edges where the image ends. Widths say little: arms and stride change
/// them, and all boxes of a camera that sees people from the side are too narrow alike.
pub(super) fn box_rows(measured: &MeasuredBox, levels: Levels, predicted: &[f64; 4]) -> Vec<BoxRow> {
    let mut rows = Vec::with_capacity(4);
    for axis in 0..2 {
        let sd = |level: f64| (level * measured.size[axis]).hypot(EDGE_PX * measured.pixel[axis]);
        let off = [axis, axis + 2].map(|edge| predicted[edge] - measured.edges[edge]);
        let [center, height] = levels.0;
        if !(measured.cut_off[axis] || measured.cut_off[axis + 2]) {
            for (level, sign) in [(0, 1.0), (1, -1.0)].into_iter().take(1 + axis) {
                // Half the sum and half the difference of independent edges have a standard deviation smaller by the root of two.
                let scale = std::f64::consts::FRAC_1_SQRT_2 / sd(levels.0[level]);
                let mut of_edges = [0.0; 4];
                (of_edges[axis], of_edges[axis + 2]) = (sign * scale, scale);
                rows.push(BoxRow { of_edges, residual: scale * (sign * off[0] + off[1]), level: Some(level) });
            }
            continue;
        }
        let size = if axis == 0 { WIDTH_SD } else { height };
        let scale = 1.0 / sd((0.5 * (center * center + size * size)).sqrt());
        for (edge, off, outwards) in [(axis, off[0], -off[0]), (axis + 2, off[1], off[1])] {
            if measured.cut_off[edge] && outwards >= 0.0 {
                continue;
            }
            let mut of_edges = [0.0; 4];
            of_edges[edge] = scale;
            rows.push(BoxRow { of_edges, residual: scale * off, level: None });
        }
    }
    rows
}

/// A box of a body.
#[derive(Debug, Clone)]
pub(super) struct Observation {
    pub camera: usize,
    /// Index among the boxes of the rig.
    pub box_index: usize,
    pub measured: MeasuredBox,
}

/// A body at one place: an object at a time step, or one that stands still. Sites are in the order of their time steps.
#[derive(Debug, Clone)]
pub(super) struct Site {
    pub shape: usize,
    /// Whether it keeps its height above the floor with others of its shape.
    pub walks: bool,
    pub observations: Vec<Observation>,
}

/// What is known of a shape.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct ShapePrior {
    pub category: usize,
    /// A body with a vertical; otherwise a ball.
    pub upright: bool,
    /// Logarithm of the half height, with its standard deviation.
    pub log_height: Option<[f64; 2]>,
    /// Logarithm of half height over radius, with its standard deviation.
    pub log_ratio: [f64; 2],
}

/// A distance of two cameras that is known.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct DistanceRow {
    pub cameras: [usize; 2],
    pub length: f64,
    pub sd: f64,
}

/// Everything but the unknowns.
#[derive(Debug, Clone)]
pub(super) struct Problem {
    /// Whether the pose of a camera is sought.
    pub free: Vec<bool>,
    pub up_free: bool,
    pub shapes: Vec<ShapePrior>,
    pub sites: Vec<Site>,
    /// By category.
    pub levels: Vec<Levels>,
    /// By camera: its noise over that of all cameras.
    pub noise_ratios: Vec<f64>,
    /// Standard deviation of the heights at which an object walks, relative to its half height.
    pub step_level: f64,
    pub baselines: Vec<DistanceRow>,
}

/// The unknowns.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct State {
    /// Of cameras that are placed.
    pub poses: Vec<Pose>,
    pub up: Vector3<f64>,
    pub shapes: Vec<Shape>,
    /// Height of the centers of a shape that walks, along `up`.
    pub heights: Vec<f64>,
    pub places: Vec<Vector3<f64>>,
}

/// Number of unknowns of a box besides the place: camera 6, vertical 2, shape 3.
pub(super) const SHARED: usize = 11;

/// A row of the Jacobian of a site, whitened.
#[derive(Debug, Clone)]
pub(super) struct Row {
    pub residual: f64,
    pub shared: [f64; SHARED],
    pub place: Vector3<f64>,
    pub camera: Option<usize>,
    /// Derivative by the logarithm of the focal length.
    pub by_focal: f64,
    /// Category and level, for the noise.
    pub level: Option<(usize, usize)>,
}

impl Problem {
    /// The noise of the edges of a camera.
    pub(super) fn edge_noise(&self, camera: usize) -> Option<f64> {
        let category = self.shapes[self.sites.first()?.shape].category;
        let [center, height] = self.levels[category].0;
        Some((0.5 * (center * center + height * height)).sqrt() * self.noise_ratios[camera])
    }

    /// The rows of a site; `None` where a body is not in front of a camera.
    pub(super) fn rows(&self, state: &State, site: usize) -> Option<Vec<Row>> {
        let Site { shape: index, walks, ref observations, .. } = self.sites[site];
        let (shape, prior, place) = (state.shapes[index], &self.shapes[index], &state.places[site]);
        let tangent = across(&state.up);
        let mut rows = Vec::with_capacity(4 * observations.len() + 1);
        for Observation { camera, measured, .. } in observations {
            let predicted = Predicted::new(&state.poses[*camera], place, &state.up, shape)?;
            let slopes: [_; 4] = std::array::from_fn(|edge| predicted.slope(edge));
            let levels = self.levels[prior.category].times(self.noise_ratios[*camera]);
            for row in box_rows(measured, levels, &predicted.edges) {
                let mut shared = [0.0; SHARED];
                let mut by_place = Vector3::zeros();
                for (slope, factor) in slopes.iter().zip(row.of_edges) {
                    if factor == 0.0 {
                        continue;
                    }
                    for k in 0..3 {
                        shared[k] += factor * slope.turn[k];
                        shared[3 + k] += factor * slope.shift[k];
                    }
                    for k in 0..2 {
                        shared[6 + k] += factor * slope.up.dot(&tangent.column(k));
                    }
                    if prior.upright {
                        shared[8] += factor * slope.log_radius;
                        shared[9] += factor * slope.log_height;
                    } else {
                        shared[9] += factor * (slope.log_radius + slope.log_height);
                    }
                    by_place += slope.center * factor;
                }
                let level = row.level.map(|level| (prior.category, level));
                let by_focal = row.of_edges.iter().zip(&measured.edges).map(|(factor, edge)| factor * edge).sum();
                rows.push(Row {
                    residual: row.residual,
                    shared,
                    place: by_place,
                    camera: Some(*camera),
                    by_focal,
                    level,
                });
            }
        }
        if walks {
            let scale = 1.0 / (self.step_level * shape.log_height.exp());
            let residual = scale * (state.up.dot(place) - state.heights[index]);
            let mut shared = [0.0; SHARED];
            for k in 0..2 {
                shared[6 + k] = scale * tangent.column(k).dot(place);
            }
            shared[9] = -residual;
            shared[10] = -scale;
            rows.push(Row { residual, shared, place: state.up * scale, camera: None, by_focal: 0.0, level: None });
        }
        Some(rows)
    }

    /// Cost of what is known about the unknowns themselves; each residual with its derivatives by unknowns (see `Layout`) is given to
    /// `add`.
    pub(super) fn prior_rows(&self, state: &State, mut add: impl FnMut(f64, &[(Unknown, f64)])) {
        let mut is_seen = vec![false; self.shapes.len()];
        self.sites.iter().for_each(|site| is_seen[site.shape] = true);
        for (k, (prior, shape)) in self.shapes.iter().zip(&state.shapes).enumerate() {
            if !is_seen[k] {
                // Such as that of false boxes which belong to others once the vertical is known: its size would be open.
                continue;
            }
            if let Some([mean, sd]) = prior.log_height {
                add((shape.log_height - mean) / sd, &[(Unknown::Shape(k, 1), 1.0 / sd)]);
            }
            if prior.upright {
                let [mean, sd] = prior.log_ratio;
                let residual = (shape.log_height - shape.log_radius - mean) / sd;
                add(residual, &[(Unknown::Shape(k, 1), 1.0 / sd), (Unknown::Shape(k, 0), -1.0 / sd)]);
            }
        }
        for known in &self.baselines {
            let [a, b] = known.cameras.map(|camera| &state.poses[camera]);
            let between = a.center() - b.center();
            let length = between.norm();
            if length <= 0.0 {
                continue;
            }
            // A shift in the frame of the camera moves the center the other way.
            let direction = between / (length * known.sd);
            let (of_a, of_b) = (-(a.rotation * direction), b.rotation * direction);
            let derivative = |k: usize| {
                let camera = known.cameras[k / 3];
                (Unknown::Camera(camera, 3 + k % 3), if k < 3 { of_a[k] } else { of_b[k - 3] })
            };
            add((length - known.length) / known.sd, &std::array::from_fn::<_, 6, _>(derivative));
        }
    }
}

/// An unknown, and which of its numbers.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Unknown {
    /// Turn 0 to 2, shift 3 to 5.
    Camera(usize, usize),
    /// Logarithms of radius 0 and half height 1.
    Shape(usize, usize),
}

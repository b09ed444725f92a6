//! What the measurements of objects and of points tell about the cameras (docs/method.md, section 11.2).

use std::collections::BTreeMap;

use nalgebra::{Matrix6, SMatrix, SVector, Vector6};

use crate::optimize::normal_equations::PARAMETERS;

/// Correction of a camera: a rotation about its center (rotation vector, radians) and a shift (world units), both in
/// world axes.
pub(crate) type Motion = Vector6<f64>;

/// What the measurements of an object, or of a point, with `N` parameters in one frame tell about the camera.
#[derive(Debug, Clone)]
pub(crate) struct FrameTerm<const N: usize = PARAMETERS> {
    /// Index of the frame.
    pub frame: usize,
    /// Sum of weighted products of the derivatives by the motion.
    pub information: Matrix6<f64>,
    /// Sum of weighted products of residuals and derivatives.
    pub gradient: Motion,
    /// Products of the derivatives by the motion and by the parameters.
    pub coupling: SMatrix<f64, 6, N>,
}

impl<const N: usize> FrameTerm<N> {
    /// Nothing about a frame.
    pub(crate) fn new(frame: usize) -> Self {
        Self { frame, information: Matrix6::zeros(), gradient: Motion::zeros(), coupling: SMatrix::zeros() }
    }

    /// Adds a residual with its derivatives by the motion and by the parameters.
    pub(crate) fn add(&mut self, residual: f64, by_motion: &Motion, by_parameters: &[f64; N], weight: f64) {
        self.information += by_motion * by_motion.transpose() * weight;
        self.gradient += by_motion * (residual * weight);
        self.coupling += by_motion * SVector::from(*by_parameters).transpose() * weight;
    }

    /// The same about a motion by which that of the camera has this derivative.
    pub(super) fn by(&self, by: &Matrix6<f64>) -> Self {
        Self {
            frame: self.frame,
            information: by.transpose() * self.information * by,
            gradient: by.tr_mul(&self.gradient),
            coupling: by.transpose() * self.coupling,
        }
    }

    /// Adds what another frame tells, if it has the same motion.
    pub(crate) fn merge(&mut self, other: &Self) {
        self.information += other.information;
        self.gradient += other.gradient;
        self.coupling += other.coupling;
    }
}

/// What an object, or a point, with `N` parameters tells about the cameras that see it.
#[derive(Debug, Clone)]
pub(crate) struct PoseTerms<const N: usize = PARAMETERS> {
    /// By frame, each once; by unknown after [`super::pose_unknowns::PoseUnknowns::of_terms`].
    pub frames: Vec<FrameTerm<N>>,
    /// Products of the derivatives by the motions of two unknowns that move the same camera: the larger number, the smaller one.
    pub cross: Vec<((usize, usize), Matrix6<f64>)>,
    /// Covariance of the parameters were the cameras known.
    pub covariance: SMatrix<f64, N, N>,
    /// The step that the parameters are still from their minimum.
    pub step: SVector<f64, N>,
}

/// What an object tells about the cameras.
pub(crate) type ObjectPoseTerms = PoseTerms<PARAMETERS>;

/// What a point tells about the cameras.
pub(crate) type PointPoseTerms = PoseTerms<3>;

impl<const N: usize> PoseTerms<N> {
    /// The terms if so many frames that follow each other have one motion, and cameras none in their rig.
    pub(super) fn coarse(&self, together: f64, first_camera: usize) -> Self {
        let mut frames: BTreeMap<usize, FrameTerm<N>> = BTreeMap::new();
        for term in self.frames.iter().filter(|term| term.frame < first_camera) {
            let frame = (term.frame as f64 / together) as usize;
            frames.entry(frame).or_insert_with(|| FrameTerm::new(frame)).merge(term);
        }
        Self { frames: frames.into_values().collect(), cross: Vec::new(), ..*self }
    }

    /// Adds to each unknown its gradient and its own block of the information, with the parameters eliminated.
    pub(super) fn add_diagonal(&self, sums: &mut BTreeMap<usize, (Motion, Matrix6<f64>)>) {
        for term in &self.frames {
            let (gradient, information) = sums.entry(term.frame).or_default();
            *gradient += term.gradient + term.coupling * self.step;
            *information += term.information - term.coupling * self.covariance * term.coupling.transpose();
        }
    }
}

/// What all objects and points tell about the cameras.
#[derive(Debug, Clone, Default)]
pub(crate) struct SceneTerms {
    pub objects: Vec<ObjectPoseTerms>,
    pub points: Vec<PointPoseTerms>,
}

impl SceneTerms {
    /// The numbers of the frames, or unknowns, ascending.
    pub(super) fn numbers(&self) -> Vec<usize> {
        let of_objects = self.objects.iter().flat_map(|terms| terms.frames.iter().map(|term| term.frame));
        let of_points = self.points.iter().flat_map(|terms| terms.frames.iter().map(|term| term.frame));
        let mut numbers: Vec<usize> = of_objects.chain(of_points).collect();
        numbers.sort_unstable();
        numbers.dedup();
        numbers
    }
}

//! The kinds of noise of the synthetic experiments and the amounts at which each is measured.

use quadlift::metrics::TruthObject;
use quadlift::synthetic::{Noise, Observations, SyntheticOptions, generate};

use crate::data::TrueScene;
use crate::error::Error;
use crate::paper::CurveEnds;

/// Noise of the boxes that are no outliers, in the curve over the outlier share.
const NOISE_OF_INLIERS: f64 = 0.02;

/// A kind of noise and the amounts of a curve.
pub(crate) struct NoiseCurve {
    /// Name of the files.
    pub(crate) name: &'static str,
    pub(crate) title: &'static str,
    pub(crate) x_label: &'static str,
    /// Amounts: `step`, times 0 to `steps`.
    pub(crate) step: f64,
    pub(crate) steps: u32,
    pub(crate) make: fn(f64) -> SyntheticOptions,
    /// The paper's figure at the largest amount.
    pub(crate) paper: Option<fn(&CurveEnds) -> f64>,
}

impl NoiseCurve {
    /// The amounts of noise.
    pub(crate) fn amounts(&self) -> Vec<f64> {
        (0..=self.steps).map(|k| f64::from(k) * self.step).collect()
    }

    /// The largest amount.
    pub(crate) fn largest(&self) -> f64 {
        f64::from(self.steps) * self.step
    }

    /// Decimals that show the amounts.
    pub(crate) fn decimals(&self) -> usize {
        if self.step < 1.0 { 2 } else { 0 }
    }

    /// The scene with an amount of noise and a seed.
    pub(crate) fn scene(&self, amount: f64, seed: u64) -> Result<TrueScene, Error> {
        true_scene(&SyntheticOptions { seed, ..(self.make)(amount) })
    }
}

/// The paper's three curves.
pub(crate) const PAPER_CURVES: [NoiseCurve; 3] = [
    NoiseCurve {
        name: "rotation",
        title: "Rotation error of the ellipses (RE)",
        x_label: "largest rotation error, degrees",
        step: 5.0,
        steps: 9,
        make: |x| of_ellipses(Noise::Rotation(x)),
        paper: Some(|ends| ends.rotation),
    },
    NoiseCurve {
        name: "size",
        title: "Size error of the ellipses (SE)",
        x_label: "largest relative size error",
        step: 0.05,
        steps: 6,
        make: |x| of_ellipses(Noise::Size(x)),
        paper: Some(|ends| ends.size),
    },
    NoiseCurve {
        name: "translation",
        title: "Translation error of the ellipses (TE)",
        x_label: "largest translation error, mean semi-axes",
        step: 0.05,
        steps: 6,
        make: |x| of_ellipses(Noise::Translation(x)),
        paper: Some(|ends| ends.translation),
    },
];

/// Our two curves.
pub(crate) const OUR_CURVES: [NoiseCurve; 2] = [
    NoiseCurve {
        name: "boxes",
        title: "Noise of the box edges (ours)",
        x_label: "standard deviation, mean half sizes",
        step: 0.05,
        steps: 6,
        make: of_boxes,
        paper: None,
    },
    NoiseCurve {
        name: "outliers",
        title: "Share of wrong boxes (ours)",
        x_label: "share of outliers",
        step: 0.1,
        steps: 5,
        make: |x| SyntheticOptions { outlier_share: x, ..of_boxes(NOISE_OF_INLIERS) },
        paper: None,
    },
];

pub(crate) fn of_ellipses(noise: Noise) -> SyntheticOptions {
    SyntheticOptions { noise: vec![noise], ..Default::default() }
}

fn of_boxes(sigma: f64) -> SyntheticOptions {
    let noise = vec![Noise::BoxEdges(sigma)];
    SyntheticOptions { observations: Observations::Boxes, noise, ..Default::default() }
}

pub(crate) fn true_scene(options: &SyntheticOptions) -> Result<TrueScene, Error> {
    let synthetic = generate(options)?;
    let object = |(id, body): (String, quadlift::geometry::Body)| TruthObject {
        id,
        ellipsoid: Some(body.closest_ellipsoid()),
        cuboid: None,
    };
    let truth = synthetic.truth.into_iter().map(object).collect();
    Ok(TrueScene { sequence: "synthetic".to_owned(), scene: synthetic.scene, truth })
}

//! Statistics learned from the scene: noise, clutter rate, sizes, volume of the scene.

use nalgebra::Vector2;

use super::object::Object;
use crate::association::input::context::AssociationContext;
use crate::association::input::observations::{BoxObservation, Observations};
use crate::association::input::sizes::LogSize;
use crate::optimize::median::quantile;

/// Initial relative standard deviation of an edge, and its allowed range.
const FIRST_EDGE_SD: f64 = 0.1;
const EDGE_SD_RANGE: [f64; 2] = [0.015, 0.3];

/// Initial fraction of clutter among all boxes.
const FIRST_CLUTTER_SHARE: f64 = 0.2;

/// Minimum number of views of objects used to learn noise and sizes.
const MIN_INFORMATIVE_VIEWS: usize = 4;

/// Largest standard deviation of a frame's shift, pixels.
pub(crate) const MAX_SHIFT_SD: f64 = 10.0;

/// Learned statistics of a scene.
#[derive(Debug, Clone, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub(crate) struct SceneStatistics {
    /// Standard deviation of an edge relative to the half size of its box.
    pub edge_noise: f64,
    /// The size-independent part, pixels.
    pub edge_noise_px: f64,
    /// Logarithm of the number of clutter boxes per frame.
    pub log_clutter_rate: f64,
    /// Sizes of each category, if known.
    pub log_sizes: Vec<Option<LogSize>>,
    /// Volume of possible object centers, cubed world units: the extent of the centers; for a single object, a ball
    /// about it that reaches to its cameras. Infinite before any object is known: no object has evidence then.
    #[cfg_attr(feature = "serde", serde(with = "crate::association::statistics::infinite_as_null"))]
    pub volume: f64,
    /// Number of objects.
    pub objects: f64,
    /// For each box, the edges hidden by another object.
    pub hidden: Vec<[bool; 4]>,
    /// Shift of each frame that was subtracted from its boxes, pixels.
    #[cfg_attr(feature = "serde", serde(skip))]
    pub shifts: Vec<Vector2<f64>>,
    /// Standard deviation of the shifts, pixels.
    pub shift_sd: f64,
}

impl SceneStatistics {
    /// Before anything is learned.
    pub(crate) fn new(observations: &Observations, given_sizes: Vec<Option<LogSize>>, edge_noise_px: f64) -> Self {
        let per_frame = observations.boxes.len() as f64 / observations.cameras.len().max(1) as f64;
        Self {
            log_clutter_rate: first_log_clutter_rate(per_frame),
            log_sizes: given_sizes,
            hidden: vec![[false; 4]; observations.boxes.len()],
            shifts: vec![Vector2::zeros(); observations.cameras.len()],
            ..Self::unlearned(edge_noise_px)
        }
    }

    /// Before there is any box.
    pub(crate) fn unlearned(edge_noise_px: f64) -> Self {
        Self {
            edge_noise: FIRST_EDGE_SD,
            edge_noise_px,
            log_clutter_rate: first_log_clutter_rate(0.0),
            log_sizes: Vec::new(),
            volume: f64::INFINITY,
            objects: 1.0,
            hidden: Vec::new(),
            shifts: Vec::new(),
            shift_sd: MAX_SHIFT_SD,
        }
    }

    /// Standard deviation of the edges of a box, pixels.
    pub(crate) fn sd(&self, observation: &BoxObservation) -> f64 {
        (self.edge_noise * observation.half_size).hypot(self.edge_noise_px)
    }

    /// Edges of a box that only bound the extent of the object from below.
    pub(crate) fn one_sided(&self, index: usize, observation: &BoxObservation) -> [bool; 4] {
        std::array::from_fn(|e| observation.cut[e] || self.hidden[index][e])
    }

    /// Log density of clutter per edge of a box.
    pub(crate) fn log_clutter(&self, observation: &BoxObservation) -> f64 {
        0.25 * (self.log_clutter_rate + observation.log_clutter)
    }

    /// Learns everything but the shifts from the objects found so far.
    pub(crate) fn learn(&mut self, context: &AssociationContext, observations: &Observations, objects: &[Object]) {
        self.learn_edge_sd(observations, objects);
        let (frames, all) = (observations.cameras.len() as f64, observations.boxes.len() as f64);
        let assigned: usize = objects.iter().map(|o| o.boxes.len()).sum();
        self.log_clutter_rate = ((all - assigned as f64) / frames).max(0.02 * all / frames).max(0.02).ln();
        self.learn_sizes(&context.given_sizes, objects.iter());
        if let Some(volume) = volume_of(observations, objects) {
            self.volume = volume;
        }
        self.objects = objects.len() as f64;
    }

    /// Learns the noise from the residuals of objects.
    pub(crate) fn learn_edge_sd(&mut self, observations: &Observations, objects: &[Object]) {
        let mut errors = Vec::new();
        for object in objects.iter().filter(|o| o.boxes.len() >= MIN_INFORMATIVE_VIEWS) {
            // Nine parameters have been fitted to four edges of each view.
            let edges = 4.0 * object.boxes.len() as f64;
            let dof = (edges / (edges - 9.0)).sqrt();
            for &index in &object.boxes {
                let observation = &observations.boxes[index as usize];
                let one_sided = self.one_sided(index as usize, observation);
                let residuals = object.residuals_px(&observations.cameras[observation.frame], observation);
                let two_sided = (0..4).filter(|&e| !one_sided[e]);
                errors.extend(two_sided.map(|e| residuals[e].abs() / observation.half_size * dof));
            }
        }
        if errors.len() > 10
            && let Some(middle) = quantile(&mut errors, 0.5)
        {
            self.edge_noise = (1.4826 * middle).clamp(EDGE_SD_RANGE[0], EDGE_SD_RANGE[1]);
        }
    }

    /// Learns the sizes that are not given.
    pub(crate) fn learn_sizes<'a>(&mut self, given: &[Option<LogSize>], objects: impl Iterator<Item = &'a Object>) {
        let categories = given.len();
        let mut sizes = vec![Vec::new(); categories];
        for object in objects.filter(|o| o.boxes.len() >= MIN_INFORMATIVE_VIEWS) {
            sizes[object.category].push(object.radius.ln());
        }
        let medians: Vec<Option<f64>> = sizes.iter_mut().map(|s| quantile(s, 0.5)).collect();
        let mut deviations = Vec::new();
        for (size, middle) in sizes.iter().zip(&medians) {
            if let Some(middle) = middle
                && size.len() >= 3
            {
                deviations.extend(size.iter().map(|x| (x - middle).abs()));
            }
        }
        self.log_sizes = given.to_vec();
        if deviations.len() < 5 {
            return;
        }
        let sd = 1.3 * (1.4826 * quantile(&mut deviations, 0.5).unwrap_or(0.0)).max(0.3);
        let seen: Vec<f64> = medians.iter().flatten().copied().collect();
        let overall = seen.iter().sum::<f64>() / seen.len().max(1) as f64;
        for (log_size, middle) in self.log_sizes.iter_mut().zip(medians) {
            if log_size.is_none() {
                *log_size = Some(LogSize { mean: middle.unwrap_or(overall), sd });
            }
        }
    }
}

/// Logarithm of the number of clutter boxes per frame before any object is known.
pub(crate) fn first_log_clutter_rate(boxes_per_frame: f64) -> f64 {
    (boxes_per_frame * FIRST_CLUTTER_SHARE).max(0.05).ln()
}

/// The volume of possible object centers; `None` without objects.
pub(crate) fn volume_of(observations: &Observations, objects: &[Object]) -> Option<f64> {
    if let [lone] = objects {
        // There is no distance between objects. The distance of the cameras is a length scale of the scene.
        let depth = |&index: &u32| {
            let camera = &observations.cameras[observations.boxes[index as usize].frame];
            camera.axis.dot(&lone.center) + camera.matrix[(2, 3)]
        };
        let distance = quantile(&mut lone.boxes.iter().map(depth).collect::<Vec<f64>>(), 0.5)?;
        return (distance > 0.0).then(|| 4.0 / 3.0 * std::f64::consts::PI * distance.powi(3));
    }
    let margin = 4.0 * quantile(&mut objects.iter().map(|o| o.radius).collect::<Vec<f64>>(), 0.5)?;
    let extent: [f64; 3] = std::array::from_fn(|axis| {
        let mut places: Vec<f64> = objects.iter().map(|o| o.center[axis]).collect();
        let low = quantile(&mut places, 0.05).unwrap_or(0.0);
        quantile(&mut places, 0.95).unwrap_or(0.0) - low + margin
    });
    let longest = extent.iter().copied().fold(0.0, f64::max);
    Some(extent.iter().map(|x| x.max(0.05 * longest)).product())
}

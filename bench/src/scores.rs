//! From the scores of objects to the figures of a table: what is measured, and how it is averaged.

use quadlift::metrics::ObjectScore;

/// A mean with its standard error.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Figure {
    /// The mean.
    pub value: f64,
    /// Its standard error; absent when there is only one object.
    pub standard_error: Option<f64>,
}

/// The measures of one object.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Measure {
    /// Volume IoU of the ellipsoids (O3D of the paper); 0 without an ellipsoid.
    O3d,
    /// The same with the enclosing ellipsoid.
    EnclosingO3d,
    /// Angle between the main axes, radians; over the objects with an ellipsoid.
    ThetaErr,
    /// Whether the center lies within so many meters of the true one, in per cent; also without an ellipsoid.
    CenterWithin(f64),
    /// Volume IoU of the cuboids.
    CuboidIou,
}

impl Measure {
    /// The name in tables.
    pub fn name(self) -> String {
        match self {
            Self::O3d => "O3D".to_owned(),
            Self::EnclosingO3d => "O3D, enclosing".to_owned(),
            Self::ThetaErr => "theta_err".to_owned(),
            Self::CenterWithin(limit) => format!("center < {limit} m, %"),
            Self::CuboidIou => "cuboid IoU".to_owned(),
        }
    }

    /// Decimals that tables show.
    pub fn decimals(self) -> usize {
        match self {
            Self::O3d | Self::EnclosingO3d | Self::CuboidIou => 3,
            Self::ThetaErr => 2,
            Self::CenterWithin(_) => 0,
        }
    }

    /// The value for one object; absent if the object does not count.
    pub fn of(self, score: &ObjectScore) -> Option<f64> {
        match self {
            Self::O3d => score.iou3d,
            Self::EnclosingO3d => score.iou3d_enclosing,
            Self::ThetaErr => score.theta_err,
            Self::CenterWithin(limit) => Some(if score.center_error.is_some_and(|e| e < limit) { 100.0 } else { 0.0 }),
            Self::CuboidIou => score.cuboid_iou3d,
        }
    }

    /// The values of the objects that count.
    pub fn values(self, scores: &[ObjectScore]) -> Vec<f64> {
        scores.iter().filter_map(|score| self.of(score)).collect()
    }
}

/// The mean of some objects.
pub fn mean(values: &[f64]) -> Option<f64> {
    (!values.is_empty()).then(|| values.iter().sum::<f64>() / values.len() as f64)
}

/// The mean over sequences of the mean over the objects of each, as the paper averages; sequences without any object
/// do not count.
///
/// The standard error takes the objects as independent draws: `sum w^2 (x - mean)^2 n / (n - 1)` is the variance of
/// the mean with the weights `w = 1 / (sequences * objects of the sequence)`.
pub fn average(sequences: &[Vec<f64>]) -> Option<Figure> {
    let counted: Vec<&Vec<f64>> = sequences.iter().filter(|objects| !objects.is_empty()).collect();
    let weight = |objects: &[f64]| 1.0 / (counted.len() * objects.len()) as f64;
    let value = (!counted.is_empty())
        .then(|| counted.iter().map(|objects| weight(objects) * objects.iter().sum::<f64>()).sum::<f64>())?;
    let count: usize = counted.iter().map(|objects| objects.len()).sum();
    let spread = |objects: &[f64]| objects.iter().map(|x| (weight(objects) * (x - value)).powi(2)).sum::<f64>();
    let variance = counted.iter().map(|objects| spread(objects)).sum::<f64>() * count as f64 / (count as f64 - 1.0);
    Some(Figure { value, standard_error: (count > 1).then(|| variance.sqrt()) })
}

/// The mean over all objects, whatever their sequence.
pub fn pooled(sequences: &[Vec<f64>]) -> Option<Figure> {
    average(&[sequences.concat()])
}

/// The median, the upper one of an even number; `None` without values.
pub(crate) fn median(mut values: Vec<f64>) -> Option<f64> {
    values.sort_by(f64::total_cmp);
    values.get(values.len() / 2).copied()
}

/// The same as a figure without a standard error.
pub(crate) fn median_figure(values: Vec<f64>) -> Option<Figure> {
    median(values).map(|value| Figure { value, standard_error: None })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn averages_are_over_sequences() {
        let sequences = [vec![1.0], vec![0.0, 0.5, 0.25, 0.25], vec![]];
        assert_eq!(average(&sequences).unwrap().value, 0.625);
        assert_eq!(pooled(&sequences).unwrap().value, 0.4);
        assert_eq!(average(&[vec![], vec![]]), None);
        assert_eq!(average(&[vec![3.0]]), Some(Figure { value: 3.0, standard_error: None }));
    }

    #[test]
    fn the_standard_error_of_equal_weights_is_the_usual_one() {
        let x = [0.2, 0.5, 0.9, 0.4];
        let mean = 0.5;
        let variance = x.iter().map(|x| (x - mean) * (x - mean)).sum::<f64>() / 3.0;
        let expected = (variance / 4.0).sqrt();
        for sequences in
            [vec![x.to_vec()], x.iter().map(|x| vec![*x]).collect(), vec![x[..2].to_vec(), x[2..].to_vec()]]
        {
            assert!((average(&sequences).unwrap().standard_error.unwrap() - expected).abs() < 1e-15);
        }
    }

    #[test]
    fn centers_count_without_an_ellipsoid() {
        let score = ObjectScore { center_error: Some(1.5), iou3d: Some(0.0), ..Default::default() };
        assert_eq!(Measure::CenterWithin(1.0).of(&score), Some(0.0));
        assert_eq!(Measure::CenterWithin(2.0).of(&score), Some(100.0));
        assert_eq!((Measure::O3d.of(&score), Measure::ThetaErr.of(&score)), (Some(0.0), None));
    }
}

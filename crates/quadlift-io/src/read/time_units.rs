//! Units of times: files of one recording have seconds, and those of another program nanoseconds.

/// Units of times in seconds.
const UNITS: [f64; 3] = [1e-3, 1e-6, 1e-9];

/// Seconds since 1970, in the years 2001 to 2286.
const EPOCH: std::ops::Range<f64> = 1e9..1e10;

/// Two recordings of the same time differ in length by less than this factor.
const SAME: f64 = 2.0;

/// The seconds of one unit of two lists of times: by the times that both span, otherwise by their size if they count from
/// 1970. Seconds, unless another unit explains them.
pub(super) fn units(a: &[f64], b: &[f64]) -> [f64; 2] {
    let span = |times: &[f64]| {
        let range = times.iter().fold([f64::INFINITY, f64::NEG_INFINITY], |[low, high], x| [low.min(*x), high.max(*x)]);
        range[1] - range[0]
    };
    let ratio = span(a) / span(b);
    let is = |ratio: f64| (1.0 / SAME..SAME).contains(&ratio);
    let in_other = |ratio: f64| UNITS.into_iter().find(|unit| is(ratio * unit)).unwrap_or(1.0);
    let found = [in_other(ratio), in_other(1.0 / ratio)];
    if found != [1.0; 2] {
        return found;
    }
    [a, b].map(|times| {
        let latest = times.iter().fold(0.0, |latest: f64, time| latest.max(time.abs()));
        UNITS.into_iter().find(|unit| EPOCH.contains(&(latest * unit))).unwrap_or(1.0)
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn units_are_found_by_size_and_by_span() {
        let seconds: Vec<f64> = (0..50).map(|k| 1.403_636_579e9 + 0.05 * f64::from(k)).collect();
        let times = |factor: f64, from: f64| seconds.iter().map(|time| factor * (time - from)).collect::<Vec<f64>>();
        let [short, same] = [times(1.0, 1.403_636_579e9), times(1.0, 0.0)];
        for unit in [1e-3, 1e-6, 1e-9] {
            assert_eq!(units(&same, &times(1.0 / unit, 0.0)), [1.0, unit]);
            assert_eq!(units(&times(1.0 / unit, 0.0), &same), [unit, 1.0]);
            assert_eq!(units(&times(1.0 / unit, 0.0), &times(1.0 / unit, 0.0)), [unit, unit]);
            assert_eq!(units(&short, &times(1.0 / unit, 1.403_636_579e9)), [1.0, unit]);
        }
        for other in [&same[..], &short, &short[..5], &short[..1], &[], &[7.0, 7.0]] {
            assert_eq!(units(&short, other), [1.0, 1.0]);
        }
    }
}

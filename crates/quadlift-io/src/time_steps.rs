//! Time steps of frames that have no times.

use std::collections::BTreeSet;

use crate::scene_file::{FrameRecord, RIG_FRAME};

/// Numbers from 0 that order frames without times: frames with the same `rig_frame` share one, in the order of these, if every
/// frame has a `rig_frame`; otherwise they are the indices.
pub(crate) fn time_steps(frames: &[FrameRecord]) -> Vec<usize> {
    let number = |frame: &FrameRecord| frame.extra.get(RIG_FRAME).and_then(serde_json::Value::as_u64);
    let Some(numbers) = frames.iter().map(number).collect::<Option<Vec<u64>>>() else {
        return (0..frames.len()).collect();
    };
    let ordered: Vec<u64> = numbers.iter().copied().collect::<BTreeSet<_>>().into_iter().collect();
    numbers.iter().map(|number| ordered.partition_point(|known| known < number)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn frames_of_a_rig_share_an_time_step() {
        let frame = |number: Option<u64>| FrameRecord {
            extra: number.map(|number| (RIG_FRAME.to_owned(), number.into())).into_iter().collect(),
            ..FrameRecord::default()
        };
        let numbers = [7, 3, 7, 900].map(|number| frame(Some(number)));
        assert_eq!(time_steps(&numbers), [1, 0, 1, 2]);
        assert_eq!(time_steps(&[frame(Some(7)), frame(None), frame(Some(7))]), [0, 1, 2]);
        assert_eq!(time_steps(&[]), Vec::<usize>::new());
    }
}

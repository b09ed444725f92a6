//! Small pieces of text that several reports share.

use std::time::Duration;

pub(crate) use quadlift_io::wording::{count, some_of};

/// A duration: in milliseconds or seconds, with two decimals if it is short.
pub(crate) fn duration(time: Duration) -> String {
    let milliseconds = 1e3 * time.as_secs_f64();
    match milliseconds {
        ..10.0 => format!("{milliseconds:.2} ms"),
        ..1000.0 => format!("{milliseconds:.0} ms"),
        ..100_000.0 => format!("{:.2} s", 1e-3 * milliseconds),
        _ => format!("{:.0} s", 1e-3 * milliseconds),
    }
}

/// The title of a column with lengths, with the unit if known.
pub(crate) fn with_unit(title: &str, length_unit: Option<&str>) -> String {
    match length_unit {
        Some(unit) => format!("{title} [{unit}]"),
        None => title.to_owned(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn times_are_in_milliseconds_or_seconds() {
        let text = |microseconds: u64| duration(Duration::from_micros(microseconds));
        assert_eq!([text(110), text(3456), text(12_300)], ["0.11 ms", "3.46 ms", "12 ms"]);
        assert_eq!([text(1_234_000), text(123_400_000)], ["1.23 s", "123 s"]);
    }
}

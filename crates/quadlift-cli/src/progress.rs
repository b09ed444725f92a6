//! The progress bar, on standard error and only if it is a terminal.

use std::ops::ControlFlow;
use std::sync::{Mutex, PoisonError};

use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};

use quadlift::{Observer, Phase};

use crate::output::{Output, one_line};

/// Steps of the bar of a run.
const STEPS: f64 = 1000.0;

/// Shows a run on one bar, which never goes back.
pub(crate) struct RunProgress {
    bar: ProgressBar,
    overall: Mutex<Overall>,
}

/// How much of a run is done, from 0 to 1: each phase has a share of what was left when it began.
#[derive(Debug, Default)]
struct Overall {
    done: f64,
    start: f64,
    share: f64,
}

impl Overall {
    /// A phase with this share of the rest begins.
    fn begin(&mut self, share: f64) {
        *self = Self { done: self.done, start: self.done, share: share * (1.0 - self.done) };
    }

    /// So much of the phase is done; phases may find that there is more to do.
    fn advance(&mut self, done: usize, total: usize) -> f64 {
        let of_phase = if total == 0 { 1.0 } else { done as f64 / total as f64 };
        self.done = self.done.max(self.start + self.share * of_phase);
        self.done
    }
}

impl RunProgress {
    /// `title` precedes the bar.
    pub(crate) fn new(title: &str, out: &Output) -> Self {
        let bar = bar(title, "{percent} % {prefix} {elapsed}", out);
        bar.set_length(STEPS as u64);
        Self { bar, overall: Mutex::default() }
    }

    /// A phase with this share of the rest begins.
    pub(crate) fn begin(&self, what: &'static str, share: f64) {
        self.overall.lock().unwrap_or_else(PoisonError::into_inner).begin(share);
        self.bar.set_prefix(what);
    }
}

impl Observer for RunProgress {
    fn progress(&self, done: usize, total: usize) -> ControlFlow<()> {
        let mut overall = self.overall.lock().unwrap_or_else(PoisonError::into_inner);
        self.bar.set_position((STEPS * overall.advance(done, total)) as u64);
        ControlFlow::Continue(())
    }

    fn begins(&self, phase: Phase) {
        let (what, share) = match phase {
            Phase::Association => ("associating detections", 0.4),
            Phase::Masks => ("reading masks", 0.2),
            Phase::DepthImages => ("reading depth images", 0.2),
            Phase::Points => ("reading points", 0.2),
            _ => ("localizing objects", 1.0),
        };
        self.begin(what, share);
    }
}

impl Drop for RunProgress {
    fn drop(&mut self) {
        self.bar.finish_and_clear();
    }
}

/// A bar behind a message, and the template of what follows it.
fn bar(message: &str, after: &str, out: &Output) -> ProgressBar {
    // indicatif draws nothing on a stream that is not a terminal.
    let target = if out.quiet { ProgressDrawTarget::hidden() } else { ProgressDrawTarget::stderr() };
    let bar = ProgressBar::with_draw_target(Some(0), target).with_message(one_line(message));
    match ProgressStyle::with_template(&format!("{{msg}} {{bar:30}} {after}")) {
        Ok(style) => bar.with_style(style),
        Err(_) => bar,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_run_counts_to_one_total_and_never_back() {
        let mut overall = Overall::default();
        overall.begin(0.4);
        let mut seen =
            vec![overall.advance(0, 10), overall.advance(5, 10), overall.advance(5, 20), overall.advance(20, 20)];
        overall.begin(1.0);
        seen.extend([overall.advance(0, 4), overall.advance(2, 4), overall.advance(4, 4)]);
        for (found, expected) in seen.iter().zip([0.0, 0.2, 0.2, 0.4, 0.4, 0.7, 1.0]) {
            assert!((found - expected).abs() < 1e-12, "{seen:?}");
        }
    }
}

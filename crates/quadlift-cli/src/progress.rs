//! Progress bars, on standard error and only if it is a terminal.

use std::ops::ControlFlow;
use std::sync::{Mutex, PoisonError};

use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};

use quadlift::{Observer, Phase};

use crate::output::{Output, one_line};

/// Shows the phases of a run, each on a bar of its own.
pub struct RunProgress<'a> {
    title: &'a str,
    out: &'a Output,
    bar: Mutex<ProgressBar>,
}

impl<'a> RunProgress<'a> {
    /// `title` precedes the bars.
    pub fn new(title: &'a str, out: &'a Output) -> Self {
        Self { title, out, bar: Mutex::new(ProgressBar::hidden()) }
    }
}

impl Observer for RunProgress<'_> {
    fn progress(&self, done: usize, total: usize) -> ControlFlow<()> {
        let bar = self.bar.lock().unwrap_or_else(PoisonError::into_inner);
        bar.set_length(total as u64);
        bar.set_position(done as u64);
        ControlFlow::Continue(())
    }

    fn begins(&self, phase: Phase) {
        let things = match phase {
            Phase::Association => "association steps",
            Phase::Masks => "frames with masks",
            Phase::DepthImages => "depth images",
            Phase::Points => "frames with points",
            _ => "objects",
        };
        let mut bar = self.bar.lock().unwrap_or_else(PoisonError::into_inner);
        bar.finish_and_clear();
        *bar = counting_bar(self.title, things, self.out);
    }
}

impl Drop for RunProgress<'_> {
    fn drop(&mut self) {
        self.bar.get_mut().unwrap_or_else(PoisonError::into_inner).finish_and_clear();
    }
}

/// A bar that counts things.
pub fn counting_bar(message: &str, things: &str, out: &Output) -> ProgressBar {
    // indicatif draws nothing on a stream that is not a terminal.
    let target = if out.quiet { ProgressDrawTarget::hidden() } else { ProgressDrawTarget::stderr() };
    let bar = ProgressBar::with_draw_target(Some(0), target).with_message(one_line(message));
    match ProgressStyle::with_template(&format!("{{msg}} {{bar:30}} {{pos}}/{{len}} {things} {{elapsed}}")) {
        Ok(style) => bar.with_style(style),
        Err(_) => bar,
    }
}

//! Progress bars, on standard error and only if it is a terminal.

use std::ops::ControlFlow;

use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};

use quadlift::Observer;

use crate::output::{Output, one_line};

/// A bar that counts objects; hidden with `--quiet` and without a terminal.
pub fn object_bar(message: &str, out: &Output) -> ProgressBar {
    counting_bar(message, "objects", out)
}

/// An observer that moves a bar.
pub fn shown_on(bar: &ProgressBar) -> impl Observer + '_ {
    |done: usize, total: usize| {
        bar.set_length(total as u64);
        bar.set_position(done as u64);
        ControlFlow::Continue(())
    }
}

/// A bar that counts something else.
pub fn counting_bar(message: &str, things: &str, out: &Output) -> ProgressBar {
    // indicatif draws nothing on a stream that is not a terminal.
    let target = if out.quiet { ProgressDrawTarget::hidden() } else { ProgressDrawTarget::stderr() };
    let bar = ProgressBar::with_draw_target(Some(0), target).with_message(one_line(message));
    match ProgressStyle::with_template(&format!("{{msg}} {{bar:30}} {{pos}}/{{len}} {things} {{elapsed}}")) {
        Ok(style) => bar.with_style(style),
        Err(_) => bar,
    }
}

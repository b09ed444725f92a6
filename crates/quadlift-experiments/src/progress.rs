//! Progress: which experiment runs, and how many of its steps are done.

use std::sync::atomic::{AtomicUsize, Ordering};

/// Called with the name of the experiment, the number of steps done and their total, from any thread.
pub type Progress<'a> = &'a (dyn Fn(&str, usize, usize) + Sync);

/// The steps of one experiment.
pub struct Steps<'a> {
    name: &'static str,
    total: usize,
    done: AtomicUsize,
    progress: Progress<'a>,
}

impl<'a> Steps<'a> {
    /// Starts to count.
    pub fn new(name: &'static str, total: usize, progress: Progress<'a>) -> Self {
        progress(name, 0, total);
        Self { name, total, done: AtomicUsize::new(0), progress }
    }

    /// One more is done.
    pub fn done(&self) {
        (self.progress)(self.name, self.done.fetch_add(1, Ordering::Relaxed) + 1, self.total);
    }
}

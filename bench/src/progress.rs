//! Progress: which experiment runs, and how many of its steps are done.

use std::path::Path;
use std::sync::atomic::{AtomicUsize, Ordering};

/// Called with the name of the experiment, the number of steps done and their total, from any thread.
pub type Progress<'a> = &'a (dyn Fn(&str, usize, usize) + Sync);

/// How an experiment is run.
#[derive(Clone, Copy)]
pub struct Run<'a> {
    /// Folder of the real data; see [`crate::data::data_folder`].
    pub data: Option<&'a Path>,
    /// The same seed gives the same report, with any number of threads.
    pub seed: u64,
    /// Few scenes of each kind.
    pub short: bool,
    /// Called after each step.
    pub progress: Progress<'a>,
}

impl Run<'_> {
    /// Number of scenes of a kind: all of them, or one in the short form.
    pub(crate) fn scenes(&self, all: u64) -> u64 {
        self.either(all, 1)
    }

    /// One number, or another one in the short form.
    pub(crate) fn either(&self, all: u64, short: u64) -> u64 {
        if self.short { short } else { all }
    }

    /// All of them, or the first `short` in the short form.
    pub(crate) fn first<'b, T>(&self, all: &'b [T], short: usize) -> &'b [T] {
        if self.short { &all[..short.min(all.len())] } else { all }
    }
}

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

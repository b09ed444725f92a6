//! Progress of long work, and how it is canceled.

use std::ops::ControlFlow;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};

/// Watches long work and may cancel it.
///
/// Implemented for closures:
///
/// ```
/// use std::ops::ControlFlow;
///
/// let print = |done: usize, total: usize| {
///     eprintln!("{done} of {total}");
///     ControlFlow::Continue(())
/// };
/// quadlift::localize_observed(&Default::default(), &Default::default(), &print)?;
/// # Ok::<(), quadlift::LocalizeError>(())
/// ```
pub trait Observer: Sync {
    /// Called now and then, from any thread and not always in order, with the number of steps done and their total, which
    /// may grow. [`ControlFlow::Break`] cancels the work: it ends soon with an error that says so.
    fn progress(&self, done: usize, total: usize) -> ControlFlow<()>;

    /// Another piece of work begins, whose steps are counted from 0.
    fn begins(&self, _: Phase) {}
}

/// A piece of the work of [`crate::run()`].
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
#[non_exhaustive]
pub enum Phase {
    /// Detections are associated.
    Association,
    /// Masks are read; steps are frames.
    Masks,
    /// Depth images are read; steps are frames.
    DepthImages,
    /// Points are read; steps are frames.
    Points,
    /// Objects are solved.
    Objects,
}

impl<F: Fn(usize, usize) -> ControlFlow<()> + Sync> Observer for F {
    fn progress(&self, done: usize, total: usize) -> ControlFlow<()> {
        self(done, total)
    }
}

/// Nobody watches.
#[derive(Debug, Clone, Copy, Default)]
pub struct Unobserved;

impl Observer for Unobserved {
    fn progress(&self, _: usize, _: usize) -> ControlFlow<()> {
        ControlFlow::Continue(())
    }
}

/// Counts the steps of some work for its observer, from any thread, and remembers whether it was canceled.
pub struct Watch<'a> {
    observer: &'a dyn Observer,
    done: AtomicUsize,
    total: AtomicUsize,
    canceled: AtomicBool,
}

impl std::fmt::Debug for Watch<'_> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Watch").field("done", &self.done).field("total", &self.total).finish_non_exhaustive()
    }
}

impl<'a> Watch<'a> {
    /// Of work with so many steps.
    pub fn new(observer: &'a dyn Observer, total: usize) -> Self {
        let (done, canceled) = (AtomicUsize::new(0), AtomicBool::new(false));
        Self { observer, done, total: AtomicUsize::new(total), canceled }
    }

    /// So many more steps are done.
    pub fn advance(&self, steps: usize) {
        let done = self.done.fetch_add(steps, Ordering::Relaxed) + steps;
        self.ask(done);
    }

    /// All steps so far are done.
    pub(crate) fn finish(&self) {
        let total = self.total.load(Ordering::Relaxed);
        self.done.store(total, Ordering::Relaxed);
        self.ask(total);
    }

    /// There is more to do than was known.
    pub(crate) fn extend(&self, steps: usize) {
        self.total.fetch_add(steps, Ordering::Relaxed);
    }

    /// Asks the observer whether to go on.
    pub(crate) fn poll(&self) {
        self.ask(self.done.load(Ordering::Relaxed));
    }

    /// Whether to stop before the item with this index, of many that are done in parallel: the observer is asked at one of
    /// sixteen.
    pub(crate) fn stops_before(&self, index: usize) -> bool {
        if index.is_multiple_of(16) {
            self.poll();
        }
        self.is_canceled()
    }

    /// Whether the observer has canceled the work.
    pub fn is_canceled(&self) -> bool {
        self.canceled.load(Ordering::Relaxed)
    }

    fn ask(&self, done: usize) {
        let total = self.total.load(Ordering::Relaxed);
        if self.observer.progress(done.min(total), total).is_break() {
            self.canceled.store(true, Ordering::Relaxed);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::sync::Mutex;

    #[test]
    fn steps_are_counted_and_a_break_is_remembered() {
        let seen = Mutex::new(Vec::new());
        let observer = |done: usize, total: usize| {
            seen.lock().unwrap().push((done, total));
            if done == 3 { ControlFlow::Break(()) } else { ControlFlow::Continue(()) }
        };
        let watch = Watch::new(&observer, 4);
        watch.advance(1);
        watch.poll();
        assert!(!watch.is_canceled());
        watch.advance(2);
        watch.finish();
        watch.extend(2);
        watch.advance(5);
        assert!(watch.is_canceled());
        assert_eq!(*seen.lock().unwrap(), [(1, 4), (1, 4), (3, 4), (4, 4), (6, 6)]);
    }
}

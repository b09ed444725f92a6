//! Long work without Python's lock, with progress, and with Ctrl-C.

use std::ops::ControlFlow;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::sync::mpsc::{RecvTimeoutError, channel};
use std::sync::{Arc, Mutex};
use std::thread;
use std::time::Duration;

use pyo3::prelude::*;
use quadlift::{Observer, Phase};
use rayon::ThreadPool;

use crate::error::refuse;

/// Interval of progress reports and signal checks.
const INTERVAL: Duration = Duration::from_millis(50);

/// The solvers need more than the two megabytes that a thread has by default only in debug builds.
const STACK: usize = 8 << 20;

/// Messages to and from the working thread.
#[derive(Default)]
pub(crate) struct Ticker {
    done: AtomicUsize,
    total: AtomicUsize,
    canceled: AtomicBool,
}

impl Observer for Ticker {
    fn progress(&self, done: usize, total: usize) -> ControlFlow<()> {
        // Several threads come here, not always in order.
        self.done.fetch_max(done, Ordering::Relaxed);
        self.total.store(total, Ordering::Relaxed);
        if self.canceled.load(Ordering::Relaxed) { ControlFlow::Break(()) } else { ControlFlow::Continue(()) }
    }

    fn begins(&self, _: Phase) {
        self.restart();
    }
}

impl Ticker {
    /// Begins a new piece of work, whose counts start from 0.
    pub(crate) fn restart(&self) {
        self.done.store(0, Ordering::Relaxed);
    }

    fn tell(&self, py: Python, progress: Option<&Py<PyAny>>, last: &mut (usize, usize)) -> PyResult<()> {
        let now = (self.done.load(Ordering::Relaxed), self.total.load(Ordering::Relaxed));
        if let Some(progress) = progress
            && now != *last
        {
            *last = now;
            progress.call1(py, now)?;
        }
        Ok(())
    }
}

/// The threads that this process shares, and the process whose they are.
static POOL: Mutex<Option<(u32, Arc<ThreadPool>)>> = Mutex::new(None);

/// A pool of threads; of 0, as many as there are cores.
fn new_pool(count: usize) -> Result<Arc<ThreadPool>, String> {
    let pool = rayon::ThreadPoolBuilder::new().num_threads(count).stack_size(STACK).build();
    pool.map(Arc::new).map_err(|error| format!("cannot start the threads: {error}"))
}

/// The threads that this process shares. Rayon's own pool cannot serve: a child that a fork has made (multiprocessing on
/// Linux) has the pool but none of its threads, and work for them would never be done.
fn shared_pool() -> Result<Arc<ThreadPool>, String> {
    // A fork while another thread is here leaves the lock taken for ever in the child: do without.
    let Ok(mut shared) = POOL.try_lock() else { return new_pool(0) };
    if let Some((process, pool)) = &*shared
        && *process == std::process::id()
    {
        return Ok(Arc::clone(pool));
    }
    let pool = new_pool(0)?;
    // To drop the parent's pool would wait for its threads.
    std::mem::forget(shared.replace((std::process::id(), Arc::clone(&pool))));
    Ok(pool)
}

/// Does `work` on the threads that this process shares.
pub(crate) fn on_threads<T: Send>(work: impl FnOnce() -> T + Send) -> PyResult<T> {
    Ok(shared_pool().map_err(refuse)?.install(work))
}

/// Runs `work` on another thread, with a pool of `threads` threads if given. Meanwhile this thread calls
/// `progress(done, total)` and checks signals: an exception in either cancels the work and is raised.
pub(crate) fn in_background<T: Send + 'static>(
    py: Python,
    threads: Option<usize>,
    progress: Option<Py<PyAny>>,
    work: impl FnOnce(&Ticker) -> Result<T, String> + Send + 'static,
) -> PyResult<T> {
    let ticker = Arc::new(Ticker::default());
    let of_worker = Arc::clone(&ticker);
    let (sender, mut receiver) = channel();
    let body = move || {
        let result = catch_unwind(AssertUnwindSafe(|| match threads {
            None => shared_pool()?.install(|| work(&of_worker)),
            Some(count) => new_pool(count)?.install(|| work(&of_worker)),
        }));
        // The receiver is gone only where the work was canceled.
        let _ = sender.send(result);
    };
    thread::Builder::new()
        .stack_size(STACK)
        .spawn(body)
        .map_err(|error| refuse(format!("cannot start a thread: {error}")))?;
    let mut last = (0, 0);
    loop {
        let waiting = &mut receiver;
        let received = py.detach(move || waiting.recv_timeout(INTERVAL));
        let cancel = |error| {
            ticker.canceled.store(true, Ordering::Relaxed);
            error
        };
        match received {
            Ok(result) => {
                ticker.tell(py, progress.as_ref(), &mut last)?;
                return match result {
                    Ok(result) => result.map_err(refuse),
                    Err(_) => Err(refuse(INTERNAL)),
                };
            }
            Err(RecvTimeoutError::Disconnected) => return Err(refuse(INTERNAL)),
            Err(RecvTimeoutError::Timeout) => {
                py.check_signals().map_err(cancel)?;
                ticker.tell(py, progress.as_ref(), &mut last).map_err(cancel)?;
            }
        }
    }
}

/// The message of internal errors.
const INTERNAL: &str = "internal error in quadlift; please report it with the input that causes it";

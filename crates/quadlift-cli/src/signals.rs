//! Ctrl-C and other signals that end the program: its temporary files are removed first, or a command ends by itself.

#[cfg(unix)]
use std::sync::{Mutex, PoisonError};

/// What the first signal does instead of ending the program.
#[cfg(unix)]
static INSTEAD: Mutex<Option<Box<dyn FnOnce() + Send>>> = Mutex::new(None);

/// The first signal from now on calls this, which must not wait for anything, and the program goes on. The next one ends it.
#[cfg(unix)]
pub(crate) fn call_instead_of_ending(action: impl FnOnce() + Send + 'static) {
    *INSTEAD.lock().unwrap_or_else(PoisonError::into_inner) = Some(Box::new(action));
}

#[cfg(not(unix))]
pub(crate) fn call_instead_of_ending(_: impl FnOnce() + Send + 'static) {}

/// Starts a thread that waits for Ctrl-C, SIGTERM and SIGHUP, removes the temporary files and ends the program as the
/// signal would have done. Signals that are ignored (`nohup`) stay ignored.
#[cfg(unix)]
pub(crate) fn remove_temporary_files_at_the_end() {
    use signal_hook::consts::{SIGHUP, SIGINT, SIGTERM};
    use signal_hook::iterator::Signals;

    let ignored = ignored_signals();
    let waited_for = [SIGINT, SIGTERM, SIGHUP].into_iter().filter(|signal| ignored >> (signal - 1) & 1 == 0);
    // Without this the program still works; what it leaves behind is removed at the next write.
    let Ok(mut signals) = Signals::new(waited_for) else { return };
    let wait = move || {
        for signal in signals.forever() {
            let action = INSTEAD.lock().unwrap_or_else(PoisonError::into_inner).take();
            if let Some(action) = action {
                action();
                continue;
            }
            quadlift_io::remove_temporary_files();
            let _ = signal_hook::low_level::emulate_default_handler(signal);
            return;
        }
    };
    let _ = std::thread::Builder::new().name("signals".to_owned()).spawn(wait);
}

#[cfg(not(unix))]
pub(crate) fn remove_temporary_files_at_the_end() {}

/// The set of signals that this process ignores, signal 1 in the lowest bit; if unknown, SIGHUP, which `nohup` ignores.
#[cfg(unix)]
fn ignored_signals() -> u64 {
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let line = status.lines().find_map(|line| line.strip_prefix("SigIgn:"));
    line.and_then(|mask| u64::from_str_radix(mask.trim(), 16).ok()).unwrap_or(1)
}

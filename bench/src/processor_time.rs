//! Processor time.

use std::time::Duration;

/// Whose time it is.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Of {
    /// This program.
    Itself,
    /// All programs that it has run.
    Children,
}

/// Processor time so far; unknown on systems other than Unix.
#[cfg(unix)]
pub(crate) fn processor_time(of: Of) -> Option<Duration> {
    use nix::sys::resource::{UsageWho, getrusage};
    let used = getrusage(match of {
        Of::Itself => UsageWho::RUSAGE_SELF,
        Of::Children => UsageWho::RUSAGE_CHILDREN,
    })
    .ok()?;
    let seconds = |t: nix::sys::time::TimeVal| {
        Duration::from_secs(t.tv_sec().unsigned_abs()) + Duration::from_micros(t.tv_usec().unsigned_abs())
    };
    Some(seconds(used.user_time()) + seconds(used.system_time()))
}

#[cfg(not(unix))]
pub(crate) fn processor_time(_: Of) -> Option<Duration> {
    None
}

//! The number of threads of a command.

use anyhow::Context;

/// Starts so many threads; without a number the library starts one per core. To be called before anything else: the first call
/// of the library starts the threads.
pub(crate) fn start(threads: Option<usize>) -> anyhow::Result<()> {
    if let Some(threads) = threads {
        rayon::ThreadPoolBuilder::new().num_threads(threads).build_global().context("cannot start the threads")?;
    }
    Ok(())
}

//! `quadlift reproduce` in a program built without the feature `reproduce`: prints how to add it.

use std::ffi::OsString;

use crate::error::{Outcome, usage};
use crate::output::Output;

/// Rerun the experiments of the paper (for research; not in this build)
#[derive(clap::Args)]
#[command(hide = true, disable_help_flag = true)]
pub struct Args {
    /// Whatever follows; the program that has the command checks it.
    #[arg(allow_hyphen_values = true, trailing_var_arg = true)]
    _arguments: Vec<OsString>,
}

pub fn run(_: &Args, _: &Output) -> anyhow::Result<Outcome> {
    usage(
        "this program was built without `reproduce`, which is for research; to add it: cargo install --path \
         crates/quadlift-cli --features reproduce",
    )
}

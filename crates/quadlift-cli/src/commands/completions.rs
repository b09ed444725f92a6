//! `quadlift completions`: scripts that complete the command line.

use clap::CommandFactory;
use clap_complete::Shell;

use crate::error::Outcome;
use crate::help;
use crate::output::Output;

/// Print a script for shell completion
#[derive(clap::Args)]
#[command(after_help = "\
Examples:
  quadlift completions bash > ~/.local/share/bash-completion/completions/quadlift
  quadlift completions zsh > ~/.zfunc/_quadlift
  quadlift completions fish > ~/.config/fish/completions/quadlift.fish")]
pub(crate) struct Args {
    /// The shell
    shell: Shell,
}

pub(crate) fn run(args: &Args, out: &Output) -> anyhow::Result<Outcome> {
    let mut script = Vec::new();
    clap_complete::generate(args.shell, &mut help::grouped(crate::Cli::command()), "quadlift", &mut script);
    out.product(&String::from_utf8_lossy(&script))?;
    Ok(Outcome::Fine)
}

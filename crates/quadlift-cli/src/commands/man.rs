//! `quadlift man`: manual pages, for packages; not in the help.

use anyhow::Context;
use clap::CommandFactory;

use crate::error::{Outcome, usage};
use crate::help;
use crate::output::Output;

/// Print a manual page in roff
#[derive(clap::Args)]
#[command(after_help = "\
Examples:
  quadlift man > quadlift.1
  quadlift man localize > quadlift-localize.1")]
pub(crate) struct Args {
    /// The command; without it the page of the program
    #[arg(value_name = "COMMAND")]
    command: Option<String>,
}

pub(crate) fn run(args: &Args, out: &Output) -> anyhow::Result<Outcome> {
    let mut command = help::grouped(crate::Cli::command());
    command.build();
    if let Some(name) = &args.command {
        let Some(found) = command.find_subcommand(name) else {
            return usage(format!("there is no command \"{name}\""));
        };
        // The page has the name of its file.
        let full = format!("quadlift-{}", found.get_name());
        command = found.clone().name(full);
    }
    let mut page = Vec::new();
    clap_mangen::Man::new(command).render(&mut page).context("cannot write the page")?;
    out.product(&String::from_utf8_lossy(&page))?;
    Ok(Outcome::Fine)
}

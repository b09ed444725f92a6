//! The program `quadlift-ros2`.
#![forbid(unsafe_code)]

use std::io::Write;
use std::process::ExitCode;

use quadlift_ros2::arguments::{Arguments, Wish};
use quadlift_ros2::node;

fn main() -> ExitCode {
    let result = match Arguments::read(std::env::args().skip(1)) {
        Ok(Wish::Print(text)) => {
            // Nobody may read it.
            let _ = std::io::stdout().write_all(text.as_bytes());
            return ExitCode::SUCCESS;
        }
        // Wrong usage.
        Err(problem) => Err((2, problem)),
        Ok(Wish::Run(arguments)) => node::run(&arguments).map_err(|problem| (1, problem)),
    };
    match result {
        Ok(()) => ExitCode::SUCCESS,
        Err((code, problem)) => {
            let _ = writeln!(std::io::stderr(), "error: {}", quadlift_io::escape(&problem));
            ExitCode::from(code)
        }
    }
}

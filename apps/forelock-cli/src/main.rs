//! The `forelock` command.
//!
//! Exit status: 0 success, 1 failure with one message on standard error, 2 wrong usage, 130
//! interrupted.

mod arguments;
mod commands;
mod interrupt;
mod progress;
mod terminal;

use std::process::ExitCode;

use clap::Parser;

fn main() -> ExitCode {
    let done = match arguments::Cli::try_parse() {
        Ok(cli) => {
            terminal::start_log(cli.verbose);
            interrupt::listen().and_then(|()| commands::run(cli))
        }
        // Help and the version are printed here too, and are no failure.
        Err(stop) => terminal::written(stop.print())
            .map(|()| u8::try_from(stop.exit_code()).map_or(ExitCode::FAILURE, ExitCode::from)),
    };
    match done {
        Ok(status) => status,
        Err(error) => {
            terminal::error(&error);
            ExitCode::FAILURE
        }
    }
}

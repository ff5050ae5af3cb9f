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
    let cli = arguments::Cli::parse();
    terminal::start_log(cli.verbose);
    match interrupt::listen().and_then(|()| commands::run(cli)) {
        Ok(status) => status,
        Err(error) => {
            terminal::error(&error);
            ExitCode::FAILURE
        }
    }
}

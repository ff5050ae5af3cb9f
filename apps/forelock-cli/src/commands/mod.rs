//! The commands, one module each.

mod bench;
mod convert;
mod groom;
mod grow;
mod help;
mod info;
mod render;
mod shots;
mod simulate;
mod train;
mod view;

use std::process::ExitCode;

use anyhow::Context;
use clap::CommandFactory;
use forelock::scene::Override;

use crate::arguments::{Cli, Command};
use crate::terminal;

/// Runs the command of the command line.
pub fn run(cli: Cli) -> anyhow::Result<ExitCode> {
    if let Some(threads) = cli.threads {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads.into());
        pool.build_global().context("the threads cannot be started")?;
    }
    match cli.command {
        Command::Demo(run) => return simulate::demo(&run),
        Command::Simulate(arguments) => return simulate::simulate(&arguments),
        Command::Shots(arguments) => return shots::shots(&arguments, cli.threads),
        Command::Render(arguments) => render::render(&arguments)?,
        Command::View(arguments) => view::view(&arguments)?,
        Command::Grow(arguments) => grow::grow(&arguments)?,
        Command::Groom(arguments) => groom::groom(&arguments)?,
        Command::Info(arguments) => info::info(&arguments)?,
        Command::Convert(arguments) => convert::convert(&arguments)?,
        Command::Train(arguments) => return train::run(&arguments),
        Command::Bench(arguments) => bench::bench(&arguments)?,
        Command::Help(arguments) => help::help(&arguments)?,
        Command::Completions { shell } => {
            let mut script = Vec::new();
            clap_complete::generate(shell, &mut Cli::command(), "forelock", &mut script);
            terminal::text(&script)?;
        }
    }
    Ok(ExitCode::SUCCESS)
}

/// The overrides given by `--set`.
fn overrides(sets: &[String]) -> anyhow::Result<Vec<Override>> {
    Ok(sets.iter().map(|set| Override::set(set)).collect::<Result<_, _>>()?)
}

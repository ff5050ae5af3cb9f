//! `help`: the help of a command, or the reference of scene files.

use anyhow::Context;
use clap::CommandFactory;
use forelock::scene::reference;
use forelock::training;

use crate::arguments::{Cli, HelpArgs};
use crate::terminal;

/// Prints what is asked for.
pub fn help(arguments: &HelpArgs) -> anyhow::Result<()> {
    let topic: Vec<&str> = arguments.topic.iter().map(String::as_str).collect();
    match topic[..] {
        ["scene"] if arguments.markdown => terminal::text(reference::markdown().as_bytes()),
        ["scene"] => terminal::text(reference::help("").map_err(anyhow::Error::msg)?.as_bytes()),
        ["scene", key] => terminal::text(reference::help(key).map_err(anyhow::Error::msg)?.as_bytes()),
        ["training"] if arguments.markdown => terminal::text(training::markdown().as_bytes()),
        ["training"] => terminal::text(training::help().as_bytes()),
        _ => {
            let mut command = Cli::command();
            command.build();
            let mut found = &mut command;
            for name in topic {
                found = found.find_subcommand_mut(name).with_context(|| {
                    format!("there is no command `{name}`: `forelock help` lists all, `forelock help scene` all keys of scenes")
                })?;
            }
            terminal::text(found.render_long_help().to_string().as_bytes())
        }
    }
}

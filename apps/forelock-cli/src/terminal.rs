//! Output: results on standard output, everything else on standard error.

use std::io::{ErrorKind, Write};

use anyhow::Context;
use serde::Serialize;
use tracing_subscriber::filter::{LevelFilter, Targets};
use tracing_subscriber::fmt;
use tracing_subscriber::layer::SubscriberExt;
use tracing_subscriber::util::SubscriberInitExt;

/// Writes one line to standard output.
///
/// # Errors
/// If it cannot be written, as on a full disk. A closed pipe (as with `| head`) is not an error.
pub fn line(text: impl AsRef<str>) -> anyhow::Result<()> {
    written(writeln!(std::io::stdout(), "{}", text.as_ref()))
}

/// Writes `text` as it is to standard output.
///
/// # Errors
/// The same errors as [`line`].
pub fn text(text: &[u8]) -> anyhow::Result<()> {
    let mut out = std::io::stdout();
    written(out.write_all(text).and_then(|()| out.flush()))
}

/// The error of a write to standard output, but for that of a closed pipe.
pub fn written(result: std::io::Result<()>) -> anyhow::Result<()> {
    match result {
        Err(error) if error.kind() == ErrorKind::BrokenPipe => Ok(()),
        other => other.context("the result cannot be written to standard output"),
    }
}

/// Writes `value` as one JSON object to standard output.
///
/// # Errors
/// If `value` cannot be written as JSON, and the errors of [`line`].
pub fn json(value: &impl Serialize) -> anyhow::Result<()> {
    line(serde_json::to_string_pretty(value)?)
}

/// Writes one line to standard error.
pub fn note(text: impl AsRef<str>) {
    let _ = writeln!(std::io::stderr(), "{}", text.as_ref());
}

/// Writes the message of a failed command on one line, with its causes after colons.
pub fn error(error: &anyhow::Error) {
    let mut message = error.to_string();
    for cause in error.chain().skip(1).map(ToString::to_string) {
        // Most messages already contain their cause.
        if !message.contains(&cause) {
            message = format!("{message}: {cause}");
        }
    }
    note(format!("error: {}", message.lines().map(str::trim).collect::<Vec<_>>().join(" ")));
}

/// Sends the log of `tracing` to standard error: warnings; with `-v` information; with `-vv` debug
/// messages. `RUST_LOG` overrides the level.
pub fn start_log(verbose: u8) {
    let level = [LevelFilter::WARN, LevelFilter::INFO, LevelFilter::DEBUG];
    let level = level.get(usize::from(verbose)).copied().unwrap_or(LevelFilter::TRACE);
    let asked = std::env::var("RUST_LOG").ok().and_then(|text| text.parse::<Targets>().ok());
    let filter = asked.unwrap_or_else(|| Targets::new().with_default(level));
    tracing_subscriber::registry()
        .with(fmt::layer().with_writer(std::io::stderr).without_time())
        .with(filter)
        .init();
}

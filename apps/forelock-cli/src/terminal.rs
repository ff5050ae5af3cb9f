//! What goes to the terminal: results to standard output, everything else to standard error.

use std::io::Write;

use serde::Serialize;
use tracing_subscriber::filter::{LevelFilter, Targets};
use tracing_subscriber::fmt;
use tracing_subscriber::layer::SubscriberExt;
use tracing_subscriber::util::SubscriberInitExt;

/// Writes one line to standard output. A reader that went away (`| head`) is no failure of ours.
pub fn line(text: impl AsRef<str>) {
    let _ = writeln!(std::io::stdout(), "{}", text.as_ref());
}

/// Writes `value` as one JSON object to standard output.
///
/// # Errors
/// If it cannot be written as JSON.
pub fn json(value: &impl Serialize) -> anyhow::Result<()> {
    line(serde_json::to_string_pretty(value)?);
    Ok(())
}

/// Writes one line to standard error.
pub fn note(text: impl AsRef<str>) {
    let _ = writeln!(std::io::stderr(), "{}", text.as_ref());
}

/// Writes the one message that a failed command leaves, causes after colons, on one line.
pub fn error(error: &anyhow::Error) {
    let mut message = error.to_string();
    for cause in error.chain().skip(1).map(ToString::to_string) {
        // Most messages tell their cause themselves.
        if !message.contains(&cause) {
            message = format!("{message}: {cause}");
        }
    }
    note(format!("error: {}", message.lines().map(str::trim).collect::<Vec<_>>().join(" ")));
}

/// Sends `tracing` to standard error: warnings, with `-v` what is done, with `-vv` details. `RUST_LOG` overrides.
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

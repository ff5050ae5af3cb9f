//! What goes to the terminal: results to standard output, everything else to standard error.

use std::io::Write;

use serde::Serialize;
use tracing_subscriber::filter::EnvFilter;

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
    let level = ["warn", "info", "debug"].get(usize::from(verbose)).copied().unwrap_or("trace");
    let filter = EnvFilter::try_from_default_env().unwrap_or_else(|_| EnvFilter::new(level));
    tracing_subscriber::fmt().with_env_filter(filter).with_writer(std::io::stderr).without_time().init();
}

//! `bench`: the papers' figures as tables.

use forelock::paper::Figure;

use crate::arguments::{BenchArgs, BenchCommand};
use crate::terminal;

/// Runs a figure and prints its table.
pub fn bench(arguments: &BenchArgs) -> anyhow::Result<()> {
    let BenchCommand::Paper { figure, out, json } = &arguments.what;
    let table = if *figure == 4 { Figure::Sag } else { Figure::Angular }.table()?;
    let markdown = table.to_markdown();
    if let Some(folder) = out {
        std::fs::create_dir_all(folder)?;
        let write = |ending: &str, text: &str| {
            let path = folder.join(format!("ams-figure{figure}.{ending}"));
            forelock_io::atomic_write(&path, |file| file.write_all(text.as_bytes()))
        };
        write("md", &markdown)?;
        write("json", &serde_json::to_string_pretty(&table)?)?;
    }
    if *json {
        return terminal::json(&table);
    }
    terminal::line(markdown.trim_end());
    Ok(())
}

//! `bench`: the papers' figures as tables and pictures.

use forelock::paper::Figure;

use crate::arguments::{BenchArgs, BenchCommand};
use crate::terminal;

/// Runs a figure and prints its table.
pub fn bench(arguments: &BenchArgs) -> anyhow::Result<()> {
    let BenchCommand::Paper { figure, out, json } = &arguments.what;
    let (number, figure) = (figure, if *figure == 4 { Figure::Sag } else { Figure::Angular });
    let table = figure.table()?;
    let markdown = table.to_markdown();
    if let Some(folder) = out {
        std::fs::create_dir_all(folder)?;
        let write = |ending: &str, text: &str| {
            let path = folder.join(format!("ams-figure{number}.{ending}"));
            forelock_io::atomic_write(&path, |file| file.write_all(text.as_bytes()))
        };
        write("md", &markdown)?;
        write("json", &serde_json::to_string_pretty(&table)?)?;
        forelock::write_png(&folder.join(format!("ams-figure{number}.png")), &figure.picture(&table)?)?;
    }
    if *json {
        return terminal::json(&table);
    }
    terminal::line(markdown.trim_end());
    Ok(())
}

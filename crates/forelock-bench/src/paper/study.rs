//! What an experiment found, as Markdown, JSON and a page.

use std::fmt::Write as _;

use forelock_render::Image;
use serde::Serialize;

use crate::plot::{Bars, Plot};
use forelock::html::{base64, escape, page};

/// A table of text.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Table {
    /// What it shows.
    pub title: String,
    /// Heads of its columns; the first holds names, the others numbers.
    pub columns: Vec<String>,
    /// Its rows.
    pub rows: Vec<Vec<String>>,
}

/// What an experiment found.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Study {
    /// What was run.
    pub title: String,
    /// What the paper says of it.
    pub claim: String,
    /// Scene, counts and what the numbers mean, a sentence each.
    pub notes: Vec<String>,
    /// The numbers.
    pub tables: Vec<Table>,
    /// The numbers over time.
    pub plots: Vec<Plot>,
    /// What adds up to something.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub bars: Option<Bars>,
    /// Pictures.
    #[serde(skip)]
    pub strips: Vec<Strip>,
}

/// A picture of several.
#[derive(Clone, Debug, PartialEq)]
pub struct Strip {
    /// Short name, fit for a file.
    pub name: &'static str,
    /// What it shows.
    pub title: String,
    /// The picture.
    pub image: Image,
}

impl Table {
    pub(crate) fn new(title: &str, columns: &[&str]) -> Self {
        let columns = columns.iter().map(|&column| column.to_owned()).collect();
        Self { title: title.to_owned(), columns, rows: Vec::new() }
    }

    /// The table as Markdown, with an empty line after it.
    pub fn to_markdown(&self) -> String {
        let line = |cells: &[String]| format!("| {} |\n", cells.join(" | "));
        let rule: String = (1..self.columns.len()).map(|_| " ---: |").collect();
        let rows: String = self.rows.iter().map(|row| line(row)).collect();
        let title = if self.title.is_empty() { String::new() } else { format!("{}\n\n", self.title) };
        format!("{title}{}| --- |{rule}\n{rows}\n", line(&self.columns))
    }

    fn to_html(&self) -> String {
        let cells = |cells: &[String], tag: &str| -> String {
            let class = |column| if column == 0 { "" } else { " class=\"number\"" };
            let cells = cells.iter().enumerate();
            cells.map(|(column, text)| format!("<{tag}{}>{}</{tag}>", class(column), escape(text))).collect()
        };
        let rows: String = self
            .rows
            .iter()
            .map(|row| format!("<tr>{}</tr>", cells(row, "td")))
            .collect::<Vec<_>>()
            .join("\n");
        let title = escape(&self.title);
        format!(
            "<h2>{title}</h2><table class=\"plain\"><tr>{}</tr>\n{rows}</table>\n",
            cells(&self.columns, "th")
        )
    }
}

impl Study {
    /// Everything but the plots as Markdown.
    pub fn to_markdown(&self) -> String {
        let mut text = format!("{}\n\n", self.title);
        if !self.claim.is_empty() {
            let _ = write!(text, "The paper: {}\n\n", self.claim);
        }
        self.tables.iter().for_each(|table| text.push_str(&table.to_markdown()));
        text.push_str(&self.notes.join(" "));
        text.push('\n');
        text
    }

    /// Every plot: a short name fit for a file, its title, and an SVG document.
    pub fn pictures(&self) -> Vec<(&'static str, &str, String)> {
        let plots = self.plots.iter().map(|plot| (plot.name, plot.title.as_str(), plot.to_svg()));
        plots.chain(self.bars.iter().map(|bars| ("stages", bars.title.as_str(), bars.to_svg()))).collect()
    }

    /// A page that needs nothing but itself.
    pub fn to_html(&self) -> String {
        let paragraph = |text: &str| format!("<p>{}</p>\n", escape(text));
        let mut body = format!("<header><h1>{}</h1>", escape(&self.title));
        if !self.claim.is_empty() {
            body.push_str(&paragraph(&format!("The paper: {}", self.claim)));
        }
        body.push_str("</header>\n");
        self.tables.iter().for_each(|table| body.push_str(&table.to_html()));
        for (_, title, svg) in self.pictures() {
            let (title, image) = (escape(title), base64(svg.as_bytes()));
            let _ = writeln!(
                body,
                "<figure class=\"wide\"><img alt=\"{title}\" src=\"data:image/svg+xml;base64,{image}\"></figure>"
            );
        }
        for strip in &self.strips {
            let (title, image) = (escape(&strip.title), base64(&strip.image.to_png().unwrap_or_default()));
            let _ = writeln!(
                body,
                "<h2>{title}</h2><figure class=\"wide\"><img alt=\"{title}\" src=\"data:image/png;base64,{image}\"></figure>"
            );
        }
        body.push_str(&paragraph(&self.notes.join(" ")));
        page(&self.title, &body)
    }
}

/// A share as a percentage.
pub(super) fn percent(share: f64) -> String {
    format!("{:.1} %", 100.0 * share)
}

/// A length in millimetres.
pub(super) fn millimetres(metres: f64) -> String {
    format!("{:.1}", 1e3 * metres)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn study() -> Study {
        let mut table = Table::new("Sizes", &["which", "mm"]);
        table.rows.push(vec!["a < b".into(), "1.5".into()]);
        Study {
            title: "A study".into(),
            claim: "it holds.".into(),
            notes: vec!["One note.".into()],
            tables: vec![table],
            ..Study::default()
        }
    }

    #[test]
    fn markdown_has_title_claim_table_and_notes() {
        let expected = "A study\n\nThe paper: it holds.\n\nSizes\n\n| which | mm |\n| --- | ---: |\n| a < b | 1.5 |\n\nOne note.\n";
        assert_eq!(study().to_markdown(), expected);
    }

    #[test]
    fn the_page_is_whole_and_escaped() {
        let html = study().to_html();
        assert!(html.starts_with("<!doctype html>") && html.ends_with("</body></html>\n"), "{html}");
        assert!(html.contains("<td>a &lt; b</td><td class=\"number\">1.5</td>"), "{html}");
    }
}

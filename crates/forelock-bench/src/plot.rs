//! Line and bar plots as SVG, drawn here: nothing to install, sharp at any size, and small beside a
//! picture.

use std::fmt::Write as _;

use forelock::html::escape;
use serde::Serialize;

/// Size of a plot, and of the frame that the lines are in: left, top, right and bottom, pixels.
const SIZE: [f64; 2] = [840.0, 320.0];
const FRAME: [f64; 4] = [64.0, 34.0, 540.0, 276.0];
/// Ticks along an axis, about.
const TICKS: f64 = 5.0;
/// Most points of a line that are drawn: two a pixel would show no more.
const POINTS: usize = 480;
/// Colours of the lines in turn (Okabe and Ito 2008, distinct to colour-blind readers).
const COLOURS: [&str; 8] =
    ["#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9", "#444444", "#999999"];

/// One line of a plot.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Line {
    /// Its name in the legend.
    pub name: String,
    /// Which colour it has; lines of one colour belong together.
    pub colour: usize,
    /// Whether it is dashed.
    pub dashed: bool,
    /// Heights at equal steps of x.
    pub values: Vec<f64>,
}

/// A plot of lines over time.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Plot {
    /// Short name, fit for a file.
    pub name: &'static str,
    /// What it shows, with its unit.
    pub title: String,
    /// Seconds from one value to the next.
    pub step_secs: f64,
    /// Spans of time to be shaded, seconds: when the head moves.
    pub shaded_secs: Option<[f64; 2]>,
    /// The lines.
    pub lines: Vec<Line>,
}

impl Plot {
    /// The plot as a standalone SVG document: y from zero, or from the smallest value if that is
    /// below, to the largest.
    pub fn to_svg(&self) -> String {
        let all = || self.lines.iter().flat_map(|line| &line.values).copied().filter(|y| y.is_finite());
        let (ticks, bottom, top) = ticks(all().fold(0.0, f64::min), all().fold(0.0, f64::max));
        let longest = self.lines.iter().map(|line| line.values.len()).max().unwrap_or(0);
        let end = self.step_secs * longest.saturating_sub(1).max(1) as f64;
        let [left, up, right, down] = FRAME;
        let x = |time: f64| left + (right - left) * time / end;
        let y = |value: f64| down - (down - up) * (value - bottom) / (top - bottom);

        let mut svg = opening(&self.title, SIZE);
        if let Some([from, to]) = self.shaded_secs.map(|span| span.map(|time| x(time.clamp(0.0, end)))) {
            let (span, tall) = (to - from, down - up);
            let _ = writeln!(
                svg,
                "<rect x=\"{from:.1}\" y=\"{up}\" width=\"{span:.1}\" height=\"{tall}\" fill=\"#f0f0f0\"/>"
            );
        }
        for tick in ticks {
            let at = y(tick);
            let _ = writeln!(
                svg,
                "<path d=\"M{left} {at:.1}H{right}\" stroke=\"#ddd\"/>\
                 <text x=\"{}\" y=\"{:.1}\" text-anchor=\"end\">{}</text>",
                left - 6.0,
                at + 4.0,
                number(tick),
            );
        }
        for tick in self::ticks(0.0, end).0.into_iter().filter(|tick| *tick <= end * 1.001) {
            let at = x(tick);
            let _ = writeln!(
                svg,
                "<path d=\"M{at:.1} {down}v4\" stroke=\"#444\"/>\
                 <text x=\"{at:.1}\" y=\"{}\" text-anchor=\"middle\">{}</text>",
                down + 18.0,
                number(tick),
            );
        }
        let _ = writeln!(
            svg,
            "<path d=\"M{left} {up}V{down}H{right}\" fill=\"none\" stroke=\"#444\"/>\
             <text x=\"{right}\" y=\"{}\" text-anchor=\"end\">time, s</text>",
            down + 36.0,
        );
        for (number, line) in self.lines.iter().enumerate() {
            let colour = COLOURS[line.colour % COLOURS.len()];
            let dash = if line.dashed { " stroke-dasharray=\"6 4\"" } else { "" };
            let every = line.values.len().div_ceil(POINTS).max(1);
            let finite = line
                .values
                .iter()
                .enumerate()
                .filter(|(i, value)| i.is_multiple_of(every) && value.is_finite());
            let points: String = finite
                .map(|(i, value)| format!("{:.1},{:.1} ", x(i as f64 * self.step_secs), y(*value)))
                .collect();
            let (from, at) = (right + 16.0, up + 10.0 + 20.0 * number as f64);
            let _ = writeln!(
                svg,
                "<polyline points=\"{}\" fill=\"none\" stroke=\"{colour}\" stroke-width=\"1.6\"{dash}/>\n\
                 <path d=\"M{from} {at}h26\" stroke=\"{colour}\" stroke-width=\"2\"{dash}/>\
                 <text x=\"{}\" y=\"{}\">{}</text>",
                points.trim_end(),
                from + 32.0,
                at + 4.0,
                escape(&line.name),
            );
        }
        svg.push_str("</svg>\n");
        svg
    }
}

/// A bar of parts.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Bar {
    /// Its name.
    pub name: String,
    /// Lengths of its parts, which add up to the bar.
    pub parts: Vec<f64>,
}

/// Bars that lie below each other.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Bars {
    /// What they show, with its unit.
    pub title: String,
    /// Names of the parts.
    pub names: Vec<String>,
    /// The bars.
    pub bars: Vec<Bar>,
}

impl Bars {
    /// The bars as a standalone SVG document.
    pub fn to_svg(&self) -> String {
        let (width, left, step) = (SIZE[0], 150.0, 22.0);
        let longest =
            self.bars.iter().map(|bar| bar.parts.iter().sum::<f64>()).fold(f64::MIN_POSITIVE, f64::max);
        let scale = (width - left - 70.0) / longest;
        let height = 70.0 + step * self.bars.len() as f64;
        let colour = |part: usize| COLOURS[part % COLOURS.len()];
        let mut svg = opening(&self.title, [width, height]);
        let mut at = left;
        for (part, name) in self.names.iter().enumerate() {
            let _ = writeln!(
                svg,
                "<rect x=\"{at}\" y=\"32\" width=\"10\" height=\"10\" fill=\"{}\"/><text x=\"{}\" y=\"42\">{}</text>",
                colour(part),
                at + 14.0,
                escape(name),
            );
            at += 26.0 + 7.0 * name.chars().count() as f64;
        }
        for (number, bar) in self.bars.iter().enumerate() {
            let top = 54.0 + step * number as f64;
            let mut from = left;
            for (part, length) in bar.parts.iter().enumerate() {
                let _ = write!(
                    svg,
                    "<rect x=\"{from:.1}\" y=\"{top}\" width=\"{:.1}\" height=\"14\" fill=\"{}\"/>",
                    length * scale,
                    colour(part),
                );
                from += length * scale;
            }
            let _ = writeln!(
                svg,
                "<text x=\"{}\" y=\"{}\" text-anchor=\"end\">{}</text><text x=\"{:.1}\" y=\"{}\">{:.1}</text>",
                left - 8.0,
                top + 11.0,
                escape(&bar.name),
                from + 6.0,
                top + 11.0,
                bar.parts.iter().sum::<f64>(),
            );
        }
        svg.push_str("</svg>\n");
        svg
    }
}

/// The start of a document of `width` × `height` pixels called `title`.
fn opening(title: &str, [width, height]: [f64; 2]) -> String {
    format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 {width} {height}\" font-family=\"sans-serif\" \
         font-size=\"12\" role=\"img\">\n<title>{title}</title>\n<rect width=\"{width}\" height=\"{height}\" \
         fill=\"#fff\"/>\n<text x=\"{left}\" y=\"20\" font-size=\"14\">{title}</text>\n",
        title = escape(title),
        left = FRAME[0],
    )
}

/// Round numbers from at most `low` to at least `high`, and the first and last of them.
fn ticks(low: f64, high: f64) -> (Vec<f64>, f64, f64) {
    let range = if high > low { high - low } else { 1.0 };
    let power = 10f64.powf((range / TICKS).log10().floor());
    let step = [1.0, 2.0, 5.0, 10.0].map(|m| m * power).into_iter().find(|step| range / step <= TICKS);
    let step = step.unwrap_or(range);
    let (first, last) = ((low / step).floor(), ((low + range) / step - 1e-9).ceil());
    let ticks = (0..=(last - first) as usize).map(|i| (first + i as f64) * step).collect();
    (ticks, first * step, last * step)
}

fn number(value: f64) -> String {
    // Ticks are round: six digits hold them, and hide the last bit.
    let text = format!("{value:.6}");
    let text = text.trim_end_matches('0').trim_end_matches('.');
    if text == "-0" { "0".to_owned() } else { text.to_owned() }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ticks_are_round_and_hold_the_range() {
        for (low, high, expected) in [
            (0.0, 1.0, vec![0.0, 0.2, 0.4, 0.6, 0.8, 1.0]),
            (0.0, 0.073, vec![0.0, 0.02, 0.04, 0.06, 0.08]),
            (-0.4, 9.0, vec![-2.0, 0.0, 2.0, 4.0, 6.0, 8.0, 10.0]),
            (0.0, 0.0, vec![0.0, 0.2, 0.4, 0.6, 0.8, 1.0]),
        ] {
            let (ticks, bottom, top) = ticks(low, high);
            assert!(bottom <= low && top >= high, "{low} to {high}: {ticks:?}");
            assert_eq!(ticks.len(), expected.len(), "{ticks:?}");
            assert!(ticks.iter().zip(&expected).all(|(a, b)| (a - b).abs() < 1e-9), "{ticks:?}");
        }
    }

    #[test]
    fn values_are_drawn_where_the_axes_say() {
        let line = |values| Line { name: "a < b".into(), colour: 0, dashed: true, values };
        let plot = Plot {
            name: "test",
            title: "heights".into(),
            step_secs: 0.5,
            shaded_secs: Some([0.0, 9.0]),
            lines: vec![line(vec![0.0, 1.0, f64::NAN, 0.5])],
        };
        let svg = plot.to_svg();
        // From the lower left corner to the upper edge at a third of the width, and on without what
        // is not a number.
        assert!(svg.contains("points=\"64.0,276.0 222.7,34.0 540.0,155.0\""), "{svg}");
        assert!(svg.contains("a &lt; b") && svg.contains("stroke-dasharray"), "{svg}");
        assert_eq!(svg.matches("<svg").count(), svg.matches("</svg>").count());
    }
}

//! The two parameter sheets of the paper (main text, Figs. 13 and 14).

use super::GrowParams;

/// A table of grooms over two parameters, which is rendered as one picture.
#[derive(Clone, Debug, PartialEq)]
pub struct Sheet {
    /// Short name, usable as a file name.
    pub name: &'static str,
    /// Title of the sheet.
    pub title: &'static str,
    /// A label for each row.
    pub rows: Vec<String>,
    /// A label for each column.
    pub columns: Vec<String>,
    /// Parameters, row by row: `rows.len() * columns.len()` entries.
    pub cells: Vec<GrowParams>,
}

/// Steps p_τ of the columns, in metres.
const STEPS: [f32; 4] = [0.002, 0.004, 0.006, 0.008];
/// Helix radii p_h of the rows of Fig. 13.
const HELIX_RADII: [f32; 4] = [0.0, 10.0, 25.0, 60.0];
/// Gravities p_γ of the rows of Fig. 14.
const GRAVITIES: [f32; 4] = [0.0, 0.01, 0.03, 0.1];

/// The paper's two parameter studies with its p_Γ = 0.2, p_freq = 1, p_Ω = 0.017: curliness against
/// step, and gravity against step. The paper does not print the values of rows and columns; the
/// values here were chosen for this project.
pub fn sheets() -> [Sheet; 2] {
    let base = GrowParams { strands: 3000, ..GrowParams::default() };
    let columns: Vec<String> = STEPS.iter().map(|step| format!("p_τ = {} mm", step * 1e3)).collect();
    let sheet = |name, title, symbol, values: [f32; 4], set: fn(&mut GrowParams, f32)| Sheet {
        name,
        title,
        rows: values.iter().map(|value| format!("{symbol} = {value}")).collect(),
        columns: columns.clone(),
        cells: values
            .iter()
            .flat_map(|&value| STEPS.map(|step| (value, step)))
            .map(|(value, step)| {
                let mut cell = GrowParams { step, ..base.clone() };
                set(&mut cell, value);
                cell
            })
            .collect(),
    };
    [
        sheet(
            "curliness",
            "Helix radius p_h against step p_τ (Fig. 13)",
            "p_h",
            HELIX_RADII,
            |cell, value| {
                cell.helix_radius = value;
                cell.gravity = 0.01;
            },
        ),
        sheet("gravity", "Gravity p_γ against step p_τ (Fig. 14)", "p_γ", GRAVITIES, |cell, value| {
            cell.gravity = value;
        }),
    ]
}

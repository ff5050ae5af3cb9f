//! Predefined styles, tuned by eye on the built-in head.

use super::{GrowError, GrowParams};
use crate::body::Region;

/// Names of all presets, in display order.
pub const PRESETS: [&str; 9] =
    ["straight", "wavy", "curly", "afro", "bob", "asymmetric", "beard", "short-fur", "ponytail"];

impl GrowParams {
    /// The parameters of the preset `name`, one of [`PRESETS`].
    ///
    /// # Errors
    /// [`GrowError::Preset`] if there is no preset of that name.
    pub fn preset(name: &str) -> Result<Self, GrowError> {
        Ok(match name {
            "straight" => straight(),
            "wavy" => wavy(),
            "curly" => curly(),
            "afro" => afro(),
            "bob" => bob(),
            "asymmetric" => asymmetric(),
            "beard" => beard(),
            "short-fur" => short_fur(),
            "ponytail" => ponytail(),
            _ => return Err(GrowError::Preset(name.to_owned())),
        })
    }
}

/// Common parameters of hair that is worn down: parted, combed sideways and backwards, hanging in
/// layers.
///
fn worn() -> GrowParams {
    GrowParams {
        noise: 0.1,
        spiral: 0.0,
        margin: 2e-3,
        volume: 0.012,
        lift: 0.35,
        comb: [0.8, 0.0, -0.5],
        comb_length: 0.06,
        fade: 0.6,
        hang: 75.0,
        sweep: 1.2,
        length_variation: 0.15,
        lock_size: 0.014,
        clump: 0.5,
        flyaways: 0.015,
        ..GrowParams::default()
    }
}

fn straight() -> GrowParams {
    GrowParams { step: 0.0175, cut: 2.05, frizz: 0.01, ..worn() }
}

fn wavy() -> GrowParams {
    GrowParams {
        step: 0.0175,
        cut: 1.95,
        parting: 0.25,
        volume: 0.018,
        wave_radius: 0.006,
        wave_length: 0.075,
        wave_coherence: 0.85,
        clump: 0.6,
        frizz: 0.02,
        ..worn()
    }
}

fn curly() -> GrowParams {
    GrowParams {
        step: 0.0155,
        length_variation: 0.3,
        parting: 0.2,
        volume: 0.03,
        lift: 0.4,
        hang: 40.0,
        wave_radius: 0.009,
        wave_length: 0.06,
        wave_coherence: 0.92,
        lock_size: 0.018,
        clump: 0.75,
        frizz: 0.06,
        flyaways: 0.05,
        ..worn()
    }
}

fn afro() -> GrowParams {
    GrowParams {
        step: 0.005,
        noise: 0.3,
        spiral: 0.0,
        wave_radius: 0.004,
        wave_length: 0.03,
        wave_coherence: 0.6,
        frizz: 0.25,
        length_variation: 0.1,
        fade: 0.8,
        lock_size: 0.01,
        clump: 0.25,
        ..GrowParams::default()
    }
}

fn bob() -> GrowParams {
    GrowParams {
        step: 0.0115,
        cut: 1.2,
        volume: 0.014,
        sweep: 0.4,
        frizz: 0.01,
        length_variation: 0.06,
        clump: 0.4,
        ..worn()
    }
}

fn asymmetric() -> GrowParams {
    GrowParams {
        step: 0.0155,
        cut: 1.25,
        cut_slope: -0.8,
        parting: -0.4,
        length_variation: 0.08,
        clump: 0.45,
        ..worn()
    }
}

fn beard() -> GrowParams {
    GrowParams {
        region: Region::Beard,
        step: 0.0019,
        noise: 0.2,
        spiral: 0.0,
        margin: 5e-4,
        volume: 0.005,
        lift: 0.45,
        comb: [0.15, -1.0, 0.1],
        hang: 25.0,
        fade: 0.85,
        length_variation: 0.35,
        wave_radius: 0.0015,
        wave_length: 0.022,
        wave_coherence: 0.5,
        frizz: 0.08,
        lock_size: 0.007,
        clump: 0.5,
        ..GrowParams::default()
    }
}

fn short_fur() -> GrowParams {
    GrowParams {
        step: 0.0012,
        noise: 0.25,
        spiral: 0.0,
        margin: 5e-4,
        volume: 0.004,
        lift: 0.22,
        comb: [0.0, -0.7, 0.7],
        hang: 40.0,
        fade: 0.5,
        length_variation: 0.3,
        frizz: 0.03,
        lock_size: 0.006,
        clump: 0.25,
        width: 1.1e-4,
        ..GrowParams::default()
    }
}

fn ponytail() -> GrowParams {
    GrowParams {
        step: 0.0165,
        noise: 0.03,
        spiral: 0.0,
        margin: 2e-3,
        volume: 0.004,
        lift: 0.1,
        comb: [0.0, 0.1, -1.0],
        hang: 60.0,
        gather: [0.5, 0.62, -0.08],
        gather_radius: 0.014,
        fade: 0.85,
        length_variation: 0.2,
        frizz: 0.01,
        wave_radius: 0.002,
        wave_length: 0.12,
        lock_size: 0.02,
        clump: 0.3,
        flyaways: 0.01,
        ..GrowParams::default()
    }
}

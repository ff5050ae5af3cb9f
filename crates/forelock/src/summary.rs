//! What a run did, as numbers: the JSON summary and the times it is made from.

use std::borrow::Cow;
use std::collections::BTreeMap;
use std::path::PathBuf;

use serde::Serialize;

use crate::penetration::Penetration;

/// The JSON summary of a run. Field names and units are part of the interface.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Summary {
    /// Name of the scene.
    pub scene: String,
    /// Solver: "ams", "mass-spring", "dftl" or the name of a registered one.
    pub solver: String,
    /// Backend: "cpu" or "gpu".
    pub backend: &'static str,
    /// Name of the processor.
    pub device: String,
    /// Instructions that the solver used.
    pub simd: String,
    /// Threads of the simulation.
    pub threads: usize,
    /// Strands, S.
    pub strands: usize,
    /// Particles, P.
    pub particles: usize,
    /// Strands that were simulated as guides, which all others followed; 0 if all were simulated.
    pub guides: usize,
    /// Frames simulated since the start of the scene, over all runs that it took.
    pub frames: u32,
    /// Frames that the scene asks for; more than `frames` after an interruption.
    pub frames_asked: u32,
    /// Frames a second.
    pub fps: f64,
    /// Substeps per frame.
    pub substeps: u32,
    /// Milliseconds by the clock from the end of a frame to the end of the next: everything that a
    /// run does between its first and last frame. Pictures, films and loading are not in it.
    pub ms_per_frame: Spread,
    /// The solver's share of it: the simulation of the frame, and the strands that guides carry.
    pub solver_ms_per_frame: Spread,
    /// Median time of each stage over the frames in which it ran, milliseconds: the solver's
    /// stages, on the CPU summed over its threads, and `measure_depth` and `write_cache`, which
    /// `solver_ms_per_frame` does not include.
    pub ms_per_stage: BTreeMap<String, f64>,
    /// Largest resident memory of the process, bytes; `null` where the system does not report it.
    pub peak_memory_bytes: Option<u64>,
    /// Bytes of Model, State and Workspace.
    pub simulation_bytes: u64,
    /// Largest |l/l₀ − 1| of any edge after the length pass of any frame. No unit.
    pub max_edge_stretch: f64,
    /// The same at the end of the frame, after the final collision pass. No unit.
    pub max_edge_stretch_after_solids: f64,
    /// Penetration is measured in every so many frames
    /// ([`MEASURED_EVERY`](crate::MEASURED_EVERY)), and in the last one; 0 if
    /// hair collides with nothing.
    pub penetration_measured_every: u32,
    /// Largest depth of any particle that is not clamped inside a solid at the end of a frame that
    /// is measured, metres; measured against the mesh itself where the solid has one, as
    /// [`Player::penetration`](crate::Player::penetration) does.
    pub max_penetration_m: f64,
    /// Largest share of particles more than 1 mm inside a solid at the end of a frame, but for
    /// those clamped to the head, from the same measurement. No unit.
    pub max_share_1mm_inside: f64,
    /// Largest depth of any point of an edge, a segment between two particles, from the same
    /// measurement, metres: at most 0.1 mm too small.
    pub max_edge_penetration_m: f64,
    /// Largest share of edges that are more than 1 mm inside a solid anywhere along them, from the
    /// same measurement. No unit.
    pub max_edge_share_1mm_inside: f64,
    /// Most contacts between strands that a frame resolved; 0 without `interaction.contacts`, or
    /// where hair moves with its neighbours.
    pub max_strand_contacts: u64,
    /// Strands that became non-finite and were reset to rest, over all frames.
    pub quarantined_strands: u64,
    /// Strands, or guides where those are simulated, that sleep after the last frame.
    pub sleeping_strands: u64,
    /// Jumps of the head that were simulated as teleports: those that `[[teleport]]` declares, and
    /// those that are faster than `body.teleport_speed` or `body.teleport_turn_degrees`.
    pub teleports: u32,
    /// Hash of the final state, 16 hexadecimal digits; equal for any number of threads.
    pub state_hash: String,
    /// What the user should know of import, growth, edits and jumps, one sentence each.
    pub notes: Vec<String>,
    /// Files written.
    pub outputs: Vec<PathBuf>,
}

/// Mean, median, 95th percentile and maximum of a set of times, milliseconds.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct Spread {
    /// Their sum over their number.
    pub mean: f64,
    /// Half of the values are at most this.
    pub median: f64,
    /// 95 in 100 are at most this.
    pub p95: f64,
    /// All are at most this.
    pub max: f64,
}

impl Spread {
    /// The spread of `values`; zeros for none.
    pub fn of(values: &[f64]) -> Self {
        let mut sorted = values.to_vec();
        sorted.sort_by(f64::total_cmp);
        // The nearest-rank percentile: always one of the values.
        let at = |share: f64| {
            let rank = (share * sorted.len() as f64).ceil() as usize;
            sorted.get(rank.saturating_sub(1)).copied().unwrap_or(0.0)
        };
        let mean = values.iter().sum::<f64>() / values.len().max(1) as f64;
        Self { mean, median: at(0.5), p95: at(0.95), max: at(1.0) }
    }
}

/// One simulated frame, for progress and plots.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct FrameRow {
    /// Milliseconds by the clock from the end of the frame before to its own end.
    pub ms: f64,
    /// The solver's share of it.
    pub solver_ms: f64,
    /// Largest edge stretch at its end. No unit.
    pub stretch: f64,
    /// What is inside solids at its end, if it was measured.
    pub penetration: Option<Penetration>,
    /// Time of each stage, milliseconds.
    pub stages: Vec<(Cow<'static, str>, f64)>,
}

/// Name of the stage that carries strands by guides.
pub(crate) const SKIN_STRANDS: &str = "skin_strands";
/// Name of the stage that measures how much hair lies inside solids.
pub(crate) const MEASURE_DEPTH: &str = "measure_depth";
/// Name of the stage that writes the cache.
pub(crate) const WRITE_CACHE: &str = "write_cache";

/// Median time of each stage over `rows`, milliseconds.
pub fn median_stages(rows: &[FrameRow]) -> BTreeMap<String, f64> {
    let mut times: BTreeMap<&str, Vec<f64>> = BTreeMap::new();
    for (stage, ms) in rows.iter().flat_map(|row| &row.stages) {
        times.entry(stage).or_default().push(*ms);
    }
    times.into_iter().map(|(stage, ms)| (stage.to_owned(), Spread::of(&ms).median)).collect()
}

/// Largest resident memory of this process in bytes, where the system reports it (Linux).
pub fn peak_memory_bytes() -> Option<u64> {
    let status = std::fs::read_to_string("/proc/self/status").ok()?;
    let line = status.lines().find_map(|line| line.strip_prefix("VmHWM:"))?;
    line.trim().strip_suffix("kB")?.trim().parse::<u64>().ok().map(|kib| kib * 1024)
}

/// Name of the processor, where the system reports it; else that of its architecture.
pub fn device_name() -> String {
    let info = std::fs::read_to_string("/proc/cpuinfo").unwrap_or_default();
    let model = info.lines().find_map(|line| line.strip_prefix("model name")?.split_once(": "));
    model.map_or_else(|| std::env::consts::ARCH.to_owned(), |(_, name)| name.trim().to_owned())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn spread_is_by_nearest_rank() {
        let values: Vec<f64> = (1..=100).rev().map(f64::from).collect();
        assert_eq!(Spread::of(&values), Spread { mean: 50.5, median: 50.0, p95: 95.0, max: 100.0 });
        assert_eq!(Spread::of(&[3.0]), Spread { mean: 3.0, median: 3.0, p95: 3.0, max: 3.0 });
        assert_eq!(Spread::of(&[]), Spread::default());
    }

    #[test]
    fn stages_are_summed_up_by_name() {
        let row = |a, b| FrameRow {
            stages: vec![("solve".into(), a), ("solids".into(), b)],
            ..FrameRow::default()
        };
        let medians = median_stages(&[row(1.0, 9.0), row(3.0, 8.0), row(2.0, 7.0)]);
        assert_eq!(medians, BTreeMap::from([("solve".into(), 2.0), ("solids".into(), 8.0)]));
    }
}

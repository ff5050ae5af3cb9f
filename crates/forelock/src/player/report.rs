//! What a player reports: of a frame, and of all frames so far.

use forelock_core::frame::FrameReport;
use forelock_core::simulation::Teleport;

/// What a frame did.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct StepReport {
    /// Frames done, this one included.
    pub frame: u32,
    /// What the solver reports.
    pub solver: FrameReport,
    /// Teleports in this frame.
    pub teleports: Vec<Jump>,
}

/// A jump of the head that was simulated as a teleport.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Jump {
    /// Number of the frame that holds it, from 1.
    pub frame: u32,
    /// How far the middle of the roots jumped, metres.
    pub distance_m: f64,
    /// How far the head turned, degrees.
    pub turn_degrees: f64,
    /// What became of the hair.
    pub mode: Teleport,
    /// Whether it was declared, by the scene or from outside.
    pub declared: bool,
}

/// Sums over all frames so far.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Counters {
    /// Teleports, declared and not.
    pub teleports: u32,
    /// Jumps that were not declared.
    pub undeclared_jumps: u32,
    /// The first of them.
    pub first_undeclared: Option<Jump>,
    /// Strands that became non-finite and were reset to rest.
    pub quarantined_strands: u64,
    /// Largest |l/l₀ − 1| of any edge after the length pass of any frame.
    pub max_edge_stretch: f64,
    /// The same at the end of a frame.
    pub max_edge_stretch_final: f64,
    /// Deepest particle inside a solid at the end of any frame, metres, as the solver finds it in
    /// its distance fields; [`Player::penetration`](super::Player::penetration) measures exactly.
    pub max_penetration_m: f64,
}

impl Counters {
    pub(super) fn add_jump(&mut self, jump: &Jump) {
        self.teleports += 1;
        if !jump.declared {
            self.undeclared_jumps += 1;
            self.first_undeclared.get_or_insert(*jump);
        }
    }

    pub(super) fn add(&mut self, report: &StepReport) {
        report.teleports.iter().for_each(|jump| self.add_jump(jump));
        let solver = &report.solver;
        self.quarantined_strands += u64::from(solver.quarantined_strands);
        self.max_edge_stretch = self.max_edge_stretch.max(solver.max_edge_stretch);
        self.max_edge_stretch_final = self.max_edge_stretch_final.max(solver.max_edge_stretch_final);
        self.max_penetration_m = self.max_penetration_m.max(solver.max_penetration_m);
    }

    /// One sentence about the jumps that were not declared, if there were any.
    pub fn jump_note(&self) -> Option<String> {
        let Jump { frame, distance_m, turn_degrees, .. } = self.first_undeclared?;
        let more = match self.undeclared_jumps {
            1 => String::new(),
            count => format!(", and {} later jumps alike", count - 1),
        };
        Some(format!(
            "frame {frame}: the head jumped by {distance_m:.2} m and {turn_degrees:.0}°, which is faster than \
             body.teleport_speed or body.teleport_turn_degrees: simulated as a teleport that carries the shape{more}; \
             declare jumps with [[teleport]]"
        ))
    }
}

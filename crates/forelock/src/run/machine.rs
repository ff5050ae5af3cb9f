//! Where a run computes.

use crate::hash::Fnv;
use crate::player::Player;
use crate::summary::device_name;

/// What the times of a run depend on.
pub(super) struct Machine {
    pub backend: &'static str,
    pub device: String,
    pub simd: String,
    pub threads: usize,
}

impl Machine {
    pub fn of(player: &Player) -> Self {
        let gpu = player.gpu_name();
        Self {
            backend: if gpu.is_some() { "gpu" } else { "cpu" },
            device: gpu.map_or_else(device_name, str::to_owned),
            simd: player.simd_name(),
            threads: rayon::current_num_threads(),
        }
    }

    pub fn hash(&self) -> u64 {
        let text = [self.backend, &self.device, &self.simd, &self.threads.to_string()].join("\n");
        Fnv::new().bytes(text.as_bytes()).value()
    }
}

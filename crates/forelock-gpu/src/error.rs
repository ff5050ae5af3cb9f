//! Errors of a GPU.

use forelock_core::params::ParamsError;
use forelock_core::simulation::RegroomError;
use forelock_core::strands::PackError;
use forelock_core::strands::SnapshotError;

/// An error of a GPU.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum GpuError {
    /// No GPU, or no driver.
    #[error(
        "there is no GPU to run on ({reason}): install a Vulkan, Metal or DirectX 12 driver, or run on the CPU"
    )]
    None {
        /// The error of the search.
        reason: String,
    },
    /// No GPU has the requested name.
    #[error("no GPU is named like \"{name}\": there {}", list(.found))]
    Name {
        /// The requested name.
        name: String,
        /// The names of all GPUs.
        found: Vec<String>,
    },
    /// The GPU lacks what the kernels need.
    #[error("{name} cannot run the kernels: {reason}")]
    Unfit {
        /// The GPU.
        name: String,
        /// What it lacks.
        reason: String,
    },
    /// The device was lost, or rejected a command.
    #[error("{name} failed: {reason}; the state on it is lost, go on from the last snapshot")]
    Failed {
        /// The GPU.
        name: String,
        /// The message of the driver.
        reason: String,
    },
    /// A buffer is larger than one binding of the GPU.
    #[error(
        "{what} take {bytes} bytes, but {name} binds {limit} at once: make them smaller, or run on the CPU"
    )]
    TooLarge {
        /// What the buffer holds.
        what: &'static str,
        /// The GPU.
        name: String,
        /// Its size.
        bytes: u64,
        /// The largest binding.
        limit: u64,
    },
    /// Only the CPU supports it so far.
    #[error("{what} cannot run on a GPU yet: run on the CPU")]
    Unsupported {
        /// What.
        what: &'static str,
    },
    /// The simulated guides are not those of the skinning.
    #[error(
        "the guides that are simulated are not those that the strands follow: simulate `Skinning::guides`"
    )]
    Guides,
    /// Vertices or motions of bones are those of another skin.
    #[error("there are {found} {what}, but the skin has {expected}: take those of its own character")]
    Skin {
        /// What: "vertices" or "bones".
        what: &'static str,
        /// How many are given.
        found: usize,
        /// How many the skin has.
        expected: usize,
    },
    /// The groom cannot be packed.
    #[error(transparent)]
    Pack(#[from] PackError),
    /// A parameter is out of its range.
    #[error(transparent)]
    Params(#[from] ParamsError),
    /// The snapshot is of another groom.
    #[error(transparent)]
    Snapshot(#[from] SnapshotError),
    /// The edited groom cannot be simulated in place of the present one.
    #[error(transparent)]
    Regroom(#[from] RegroomError),
}

fn list(names: &[String]) -> String {
    match names {
        [] => "are none".to_owned(),
        [one] => format!("is {one}"),
        many => format!("are {}", many.join(", ")),
    }
}

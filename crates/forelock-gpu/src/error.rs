//! What can go wrong on a GPU.

use forelock_core::strands::PackError;
use forelock_core::params::ParamsError;
use forelock_core::strands::SnapshotError;

/// Why something cannot be done on a GPU.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum GpuError {
    /// There is no GPU, or no driver for it.
    #[error(
        "there is no GPU to run on ({reason}): install a Vulkan, Metal or DirectX 12 driver, or run on the CPU"
    )]
    None {
        /// What was looked for, and what came back.
        reason: String,
    },
    /// No GPU has that name.
    #[error("no GPU is named like \"{name}\": there {}", list(.found))]
    Name {
        /// What was asked for.
        name: String,
        /// Names of those there are.
        found: Vec<String>,
    },
    /// It cannot do what the kernels need.
    #[error("{name} cannot run the kernels: {reason}")]
    Unfit {
        /// The GPU.
        name: String,
        /// What it lacks.
        reason: String,
    },
    /// It stopped working, or refused what it was told to do.
    #[error("{name} failed: {reason}; the state on it is lost, go on from the last snapshot")]
    Failed {
        /// The GPU.
        name: String,
        /// What the driver says.
        reason: String,
    },
    /// Something takes more memory than one binding of this GPU holds.
    #[error(
        "{what} take {bytes} bytes, but {name} binds {limit} at once: make them smaller, or run on the CPU"
    )]
    TooLarge {
        /// What.
        what: &'static str,
        /// The GPU.
        name: String,
        /// What it takes.
        bytes: u64,
        /// What can be bound.
        limit: u64,
    },
    /// Something that only the CPU does so far.
    #[error("{what} cannot run on a GPU yet: run on the CPU")]
    Unsupported {
        /// What.
        what: &'static str,
    },
    /// Strands are to be carried by other guides than those that are simulated.
    #[error(
        "the guides that are simulated are not those that the strands follow: simulate `Skinning::guides`"
    )]
    Guides,
    /// The groom cannot be packed.
    #[error(transparent)]
    Pack(#[from] PackError),
    /// A parameter is out of its range.
    #[error(transparent)]
    Params(#[from] ParamsError),
    /// A snapshot of another groom.
    #[error(transparent)]
    Snapshot(#[from] SnapshotError),
}

fn list(names: &[String]) -> String {
    match names {
        [] => "are none".to_owned(),
        [one] => format!("is {one}"),
        many => format!("are {}", many.join(", ")),
    }
}

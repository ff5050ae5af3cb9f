//! The command line.

use std::path::PathBuf;

use clap::{Args, Parser, Subcommand, ValueEnum};
use clap_complete::Shell;
use forelock_core::groom::{Import, Unit, Up};

/// Real-time simulation of dense hair, strand by strand.
///
/// Start with `forelock demo`. Exit status: 0 done, 1 failed with one message, 2 wrong usage, 130 interrupted after
/// everything was put in order.
#[derive(Debug, Parser)]
#[command(
    name = "forelock",
    version,
    propagate_version = true,
    arg_required_else_help = true,
    args_override_self = true
)]
pub struct Cli {
    #[command(subcommand)]
    pub command: Command,
    /// Log what is done; twice for details.
    #[arg(short, long, global = true, action = clap::ArgAction::Count)]
    pub verbose: u8,
    /// Threads to use [default: one a processor].
    #[arg(long, global = true, value_name = "N", value_parser = clap::value_parser!(u16).range(1..=1024))]
    pub threads: Option<u16>,
}

#[derive(Debug, Subcommand)]
pub enum Command {
    /// Simulate the built-in scene: hair on a turning head; writes pictures, a cache and a report.
    Demo(RunArgs),
    /// Simulate a scene.
    Simulate(SimulateArgs),
    /// Take pictures of a scene at rest or of a cache.
    Render(RenderArgs),
    /// Grow a groom and write it to a file.
    Grow(GrowArgs),
    /// Edit a groom as a script says: cut, comb, curl and the like.
    Groom(GroomArgs),
    /// Tell what a groom or cache holds, and what is odd in it.
    Info(InfoArgs),
    /// Convert a groom between formats.
    Convert(ConvertArgs),
    /// Rerun the papers' figures as tables.
    Bench(BenchArgs),
    /// Write completions for a shell to standard output.
    Completions {
        /// The shell.
        shell: Shell,
    },
}

/// What `demo` and `simulate` have in common.
#[derive(Debug, Args)]
pub struct RunArgs {
    /// Change one key of the scene, as in `--set solver.ams.k_edge=1e7`; may be repeated, the last holds.
    #[arg(long = "set", value_name = "KEY=VALUE")]
    pub sets: Vec<String>,
    /// Frames to simulate, the same as `--set time.frames=N`.
    #[arg(long, value_name = "N", allow_negative_numbers = true)]
    pub frames: Option<i64>,
    /// Where to compute.
    #[arg(long, value_enum, default_value_t = Backend::Cpu)]
    pub backend: Backend,
    /// Compute on a graphics processor, but stages before STAGE on this one: a stage that goes wrong there is found by trying.
    #[arg(long, value_name = "STAGE", value_parser = gpu_stage, conflicts_with = "backend")]
    pub gpu_from: Option<forelock::GpuStage>,
    /// Solver, the same as `--set solver.kind=NAME`.
    #[arg(long, value_name = "NAME")]
    pub solver: Option<String>,
    /// Folder for everything that is written [default: forelock-out/NAME].
    #[arg(long, value_name = "DIR")]
    pub out: Option<PathBuf>,
    /// Name of the cache, the same as `--set output.cache=FILE`; the ending picks the format.
    #[arg(long, value_name = "FILE")]
    pub cache: Option<PathBuf>,
    /// Go on where an interrupted or shorter run into the same folder ended, bit for bit.
    #[arg(long)]
    pub resume: bool,
    /// Print the summary as one JSON object on standard output, and nothing else there.
    #[arg(long)]
    pub json: bool,
}

#[derive(Debug, Args)]
pub struct SimulateArgs {
    /// The scene file (TOML).
    #[arg(value_name = "SCENE")]
    pub scene: PathBuf,
    #[command(flatten)]
    pub run: RunArgs,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum Backend {
    /// This processor.
    Cpu,
    /// A graphics processor.
    Gpu,
    /// A graphics processor if there is one that can do what the scene asks for, else this processor.
    Auto,
}

impl RunArgs {
    /// Where to compute.
    pub fn backend(&self) -> forelock::Backend {
        self.gpu_from.map_or_else(|| self.backend.into(), forelock::Backend::GpuFrom)
    }
}

fn gpu_stage(name: &str) -> Result<forelock::GpuStage, String> {
    let all = forelock::GpuStage::ALL;
    all.into_iter().find(|stage| stage.name() == name).ok_or_else(|| {
        let names = all.map(forelock::GpuStage::name).join(", ");
        format!("should be one of {names}; the grid goes as splat_segments, contacts as find_contacts")
    })
}

impl From<Backend> for forelock::Backend {
    fn from(backend: Backend) -> Self {
        match backend {
            Backend::Cpu => Self::Cpu,
            Backend::Gpu => Self::Gpu,
            Backend::Auto => Self::Auto,
        }
    }
}

#[derive(Debug, Args)]
pub struct RenderArgs {
    /// A scene file (.toml), a cache that `simulate` wrote, or a groom.
    #[arg(value_name = "SCENE|CACHE")]
    pub input: PathBuf,
    /// Change one key of the scene, as in `--set camera.yaw_degrees=90`; may be repeated.
    #[arg(long = "set", value_name = "KEY=VALUE")]
    pub sets: Vec<String>,
    /// The picture to write; with `--film` an animated PNG [default: picture.png beside the input].
    #[arg(short, long, value_name = "FILE")]
    pub out: Option<PathBuf>,
    /// Frame of the cache [default: the last].
    #[arg(long, value_name = "N")]
    pub frame: Option<usize>,
    /// Make a film of the whole cache.
    #[arg(long, conflicts_with_all = ["frame", "sheet"])]
    pub film: bool,
    /// Make a sheet: of a cache frames over time, of a groom or scene its sides.
    #[arg(long, conflicts_with = "frame")]
    pub sheet: bool,
    /// Make a strip: the frames of the cache at these seconds, side by side, as in `--at 0,0.5,2`.
    #[arg(long, value_name = "SECS", value_delimiter = ',', conflicts_with_all = ["film", "frame", "sheet"])]
    pub at: Vec<f64>,
}

#[derive(Debug, Args)]
pub struct GrowArgs {
    /// The groom to write (.hair, .data, .tfx, .npz).
    #[arg(value_name = "FILE", required_unless_present_any = ["sheets", "picture"])]
    pub out: Option<PathBuf>,
    /// Preset to grow; a wrong one lists all.
    #[arg(long, default_value = "wavy")]
    pub preset: String,
    /// Number of strands.
    #[arg(long, default_value_t = 10_000)]
    pub strands: u32,
    /// Particles a strand.
    #[arg(long, default_value_t = 25)]
    pub vertices: u32,
    /// Seed of everything random.
    #[arg(long, default_value_t = 1)]
    pub seed: u64,
    /// Change one growth parameter, as in `--set wave_radius=0.01`; may be repeated.
    #[arg(long = "set", value_name = "KEY=VALUE")]
    pub sets: Vec<String>,
    /// Also take a picture.
    #[arg(long, value_name = "FILE")]
    pub picture: Option<PathBuf>,
    /// Make the two picture sheets of the AMS paper's Figs. 13 and 14 in this folder.
    #[arg(long, value_name = "DIR")]
    pub sheets: Option<PathBuf>,
    /// Print what was grown as one JSON object.
    #[arg(long)]
    pub json: bool,
}

#[derive(Debug, Args)]
pub struct GroomArgs {
    /// The script: a scene file (TOML) with `[[edit]]` tables.
    #[arg(value_name = "SCRIPT")]
    pub script: PathBuf,
    /// Change one key of the script, as in `--set edit.0.strength=0.5`; may be repeated, the last holds.
    #[arg(long = "set", value_name = "KEY=VALUE")]
    pub sets: Vec<String>,
    /// Folder for everything that is written [default: forelock-out/NAME].
    #[arg(long, value_name = "DIR")]
    pub out: Option<PathBuf>,
    /// Also take a picture after each edit, into the folder `steps`.
    #[arg(long)]
    pub steps: bool,
    /// Print what was done as one JSON object.
    #[arg(long)]
    pub json: bool,
}

/// How the numbers of a file become metres, y up.
#[derive(Clone, Copy, Debug, Args)]
pub struct ImportArgs {
    /// Unit of length of the file: m, cm, mm or in.
    #[arg(long, default_value = "m", value_parser = parse::<Unit>)]
    pub unit: Unit,
    /// Axis that points up in the file: y or z.
    #[arg(long, default_value = "y", value_parser = parse::<Up>)]
    pub up: Up,
    /// Further factor on all lengths.
    #[arg(long, default_value_t = 1.0, value_parser = positive, allow_negative_numbers = true)]
    pub scale: f64,
}

impl ImportArgs {
    /// The same as the library takes it.
    pub fn import(self) -> Import {
        Import { unit: self.unit, up: self.up, scale: self.scale }
    }
}

#[derive(Debug, Args)]
pub struct InfoArgs {
    /// The groom or cache.
    #[arg(value_name = "FILE")]
    pub file: PathBuf,
    #[command(flatten)]
    pub import: ImportArgs,
    /// Print one JSON object.
    #[arg(long)]
    pub json: bool,
}

#[derive(Debug, Args)]
pub struct ConvertArgs {
    /// The groom to read.
    #[arg(value_name = "IN")]
    pub input: PathBuf,
    /// The groom to write; its ending picks the format.
    #[arg(value_name = "OUT")]
    pub output: PathBuf,
    #[command(flatten)]
    pub import: ImportArgs,
    /// Resample every strand to this many particles [default: as they are].
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(2..=1000))]
    pub resample: Option<u32>,
    /// Print what was converted as one JSON object.
    #[arg(long)]
    pub json: bool,
}

#[derive(Debug, Args)]
pub struct BenchArgs {
    /// What to rerun.
    #[command(subcommand)]
    pub what: BenchCommand,
}

#[derive(Debug, Subcommand)]
pub enum BenchCommand {
    /// A paper: its tables, every scene timed, beside ours; or one figure measured.
    Paper {
        /// Which paper.
        #[arg(long, value_enum, default_value_t = WhichPaper::Ams)]
        paper: WhichPaper,
        /// Which figure [default: the tables].
        #[arg(long, value_enum)]
        figure: Option<PaperFigure>,
        /// Share of the strands, where they are grown.
        #[arg(long, default_value_t = 1.0, value_parser = share, allow_negative_numbers = true)]
        share: f64,
        /// Frames of each scene that Table 1 times.
        #[arg(long, value_name = "N", default_value_t = 60, value_parser = clap::value_parser!(u32).range(1..=100_000), conflicts_with = "figure")]
        frames: u32,
        /// Frames of each scene before those.
        #[arg(long, value_name = "N", default_value_t = 30, value_parser = clap::value_parser!(u32).range(0..=100_000), conflicts_with = "figure")]
        warm_up: u32,
        /// Where the tables are computed; scenes that cannot be computed there are skipped.
        #[arg(long, value_enum, default_value_t = BenchBackend::Cpu, conflicts_with = "figure")]
        backend: BenchBackend,
        /// Folder for Markdown, JSON, a page and plots [default: print only].
        #[arg(long, value_name = "DIR")]
        out: Option<PathBuf>,
        /// Print one JSON object instead of the table.
        #[arg(long)]
        json: bool,
    },
    /// A frame's time from a thousand strands to many, and the strand solve beside what the device can do at most.
    Scaling {
        /// Where to compute.
        #[arg(long, value_enum, default_value_t = BenchBackend::Cpu)]
        backend: BenchBackend,
        /// Strands at most, of 1,000, 10,000, 30,000, 120,000, 400,000 and 1,000,000.
        #[arg(long, value_name = "N", default_value_t = 120_000, value_parser = clap::value_parser!(u32).range(1_000..=1_000_000))]
        most: u32,
        /// Frames of each count that are timed.
        #[arg(long, value_name = "N", default_value_t = 20, value_parser = clap::value_parser!(u32).range(1..=100_000))]
        frames: u32,
        /// Strands that do not meet.
        #[arg(long)]
        apart: bool,
        /// Segments of strands that touch, too.
        #[arg(long, conflicts_with = "apart")]
        contacts: bool,
        /// Factors of the strand solve kept in 16 bits, on a GPU.
        #[arg(long)]
        half_factors: bool,
        /// Folder for Markdown, JSON and a page [default: print only].
        #[arg(long, value_name = "DIR")]
        out: Option<PathBuf>,
        /// Print one JSON object instead of the table.
        #[arg(long)]
        json: bool,
    },
}

/// Where a measurement computes.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum BenchBackend {
    /// This processor.
    Cpu,
    /// A graphics processor.
    Gpu,
}

/// The papers.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum WhichPaper {
    /// Augmented mass-spring (2025).
    Ams,
    /// Follow the leader with shape and smoothed particles (2015).
    Dftl,
}

/// The figures that can be rerun.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum PaperFigure {
    /// Sag of one strand, against mass-spring.
    #[value(name = "4")]
    Sag,
    /// What the angular spring does for a wisp.
    #[value(name = "5")]
    Angular,
    /// A hand through hair that guides carry, and through hair of which all strands are simulated.
    #[value(name = "7")]
    Guides,
    /// A beard, against mass-spring.
    #[value(name = "9")]
    Beard,
    /// The roller-coaster: damage, healing, what is left of the shape.
    #[value(name = "10")]
    RollerCoaster,
    /// A trim, geometric and simulated.
    #[value(name = "11")]
    Grooming,
    /// The asymmetric style of Fig. 1, against mass-spring.
    Asymmetric,
    /// Of follow the leader: what hair against hair and shape do.
    #[value(name = "2")]
    Volume,
    /// Follow the leader beside AMS on the five scenes of its paper.
    Compare,
}

impl PaperFigure {
    /// The paper that it is of.
    pub fn paper(self) -> WhichPaper {
        match self {
            Self::Volume | Self::Compare => WhichPaper::Dftl,
            _ => WhichPaper::Ams,
        }
    }
}

fn parse<T: std::str::FromStr>(word: &str) -> Result<T, T::Err> {
    word.parse()
}

fn share(word: &str) -> Result<f64, String> {
    match positive(word) {
        Ok(value) if value <= 1.0 => Ok(value),
        _ => Err("should be a number above 0, and 1 at most".to_owned()),
    }
}

fn positive(word: &str) -> Result<f64, String> {
    match word.parse::<f64>() {
        Ok(value) if value.is_finite() && value > 0.0 => Ok(value),
        _ => Err("should be a number above 0".to_owned()),
    }
}

#[cfg(test)]
mod tests {
    use forelock::Scene;
    use forelock::scene::{Override, SceneError};

    use super::*;

    #[test]
    fn the_readme_s_commands_are_understood() {
        let commands = commands(include_str!("../../../README.md"));
        assert!(commands.len() >= 12, "{commands:?}");
        understand(commands);
    }

    #[test]
    fn the_pages_commands_are_understood() -> std::io::Result<()> {
        let docs = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("../../docs");
        let mut all = Vec::new();
        for entry in std::fs::read_dir(docs)? {
            let path = entry?.path();
            if path.extension().is_some_and(|ending| ending == "md") {
                all.extend(commands(&std::fs::read_to_string(path)?));
            }
        }
        assert!(all.len() >= 40, "{all:?}");
        understand(all);
        Ok(())
    }

    /// The commands in the shell blocks of `page`, without comments.
    fn commands(page: &str) -> Vec<String> {
        let blocks = page.split("```sh\n").skip(1).filter_map(|rest| rest.split("```").next());
        let lines = blocks.flat_map(str::lines).map(|line| line.split(" #").next().unwrap_or(line));
        let lines = lines.map(|line| line.replace("cargo run --release -- ", "forelock "));
        lines.filter(|line| line.starts_with("forelock ")).collect()
    }

    /// Parses `commands`, and checks the keys that they set.
    fn understand(commands: Vec<String>) {
        for command in commands {
            match Cli::try_parse_from(command.split_whitespace()) {
                Ok(cli) => check_keys(&cli.command).unwrap_or_else(|error| panic!("{command}: {error}")),
                Err(error) => panic!("{command}: {error}"),
            }
        }
    }

    /// Whether a scene has every key that the command sets.
    fn check_keys(command: &Command) -> Result<(), SceneError> {
        let (prefix, sets) = match command {
            Command::Demo(run) => ("", &run.sets),
            Command::Simulate(simulate) => ("", &simulate.run.sets),
            Command::Render(render) => ("", &render.sets),
            Command::Grow(grow) => ("groom.grow.", &grow.sets),
            _ => return Ok(()),
        };
        let sets: Result<Vec<_>, _> =
            sets.iter().map(|set| Override::set(&format!("{prefix}{set}"))).collect();
        Scene::builtin(&sets?).map(drop)
    }
}

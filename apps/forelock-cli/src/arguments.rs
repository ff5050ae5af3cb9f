//! The arguments of the command line.

mod bench;

pub use bench::{BenchArgs, BenchBackend, BenchCommand, PaperFigure, WhichPaper};

use std::path::{Path, PathBuf};

use clap::{Args, Parser, Subcommand, ValueEnum};
use clap_complete::Shell;
use forelock::Scene;
use forelock::scene::{BEARD_SCENE, CHARACTER_SCENE, DEFAULT_SCENE, Override, SceneError};
use forelock_core::groom::{Import, Unit, Up};

/// Real-time simulation of dense hair, strand by strand.
///
/// Start with `forelock demo`. Exit status: 0 success, 1 failure with one message, 2 wrong usage,
/// 130 interrupted.
#[derive(Debug, Parser)]
#[command(
    name = "forelock",
    version,
    propagate_version = true,
    arg_required_else_help = true,
    args_override_self = true,
    disable_help_subcommand = true
)]
pub struct Cli {
    #[command(subcommand)]
    pub command: Command,
    /// Log the steps of the work; `-vv` logs details.
    #[arg(short, long, global = true, action = clap::ArgAction::Count)]
    pub verbose: u8,
    /// Number of threads [default: one per processor].
    #[arg(long, global = true, value_name = "N", value_parser = clap::value_parser!(u16).range(1..=1024))]
    pub threads: Option<u16>,
}

#[derive(Debug, Subcommand)]
pub enum Command {
    /// Simulate a built-in scene, hair on a turning head or a walking figure, or a beard on a head
    /// that talks, and write pictures, a cache and a report.
    Demo(DemoArgs),
    /// Simulate a scene.
    Simulate(SimulateArgs),
    /// Simulate many shots: a list of scenes with overrides and alternatives, some at a time.
    Shots(ShotsArgs),
    /// Draw pictures of a scene at rest, a cache or a groom.
    Render(RenderArgs),
    /// Open the window: watch hair move, push it, change its parameters, groom it.
    View(ViewArgs),
    /// Grow a groom and write it to a file.
    Grow(GrowArgs),
    /// Edit a groom with a script of operations such as cut, comb and curl.
    Groom(GroomArgs),
    /// Describe a groom or cache, and list the faults that were repaired.
    Info(InfoArgs),
    /// Repair a groom and convert it to another format: drop strands that cannot be simulated, and
    /// merge repeated points.
    Convert(ConvertArgs),
    /// Train the learned simulator: hair and motions in, a model of a megabyte out, with the
    /// energies of hair alone and no simulated data.
    Train(TrainArgs),
    /// Measure the scenes of the papers and the speed of this machine.
    Bench(BenchArgs),
    /// Describe a command, every key of scene files (`forelock help scene [KEY]`) or of trainings
    /// (`forelock help training`).
    Help(HelpArgs),
    /// Print completions for a shell on standard output.
    Completions {
        /// The shell.
        shell: Shell,
    },
}

#[derive(Debug, Args)]
pub struct HelpArgs {
    /// A command, or `scene` and a key such as `solver.ams.k_edge` or a table such as `solver.ams`,
    /// or `training` for all keys of `train`.
    pub topic: Vec<String>,
    /// With `scene` or `training`: print the reference as a page in Markdown.
    #[arg(long)]
    pub markdown: bool,
}

/// The scenes of `demo`.
#[derive(Clone, Copy, Debug, Default, ValueEnum)]
pub enum DemoScene {
    /// Hair on a head that turns in the wind.
    #[default]
    Head,
    /// Hair on a figure that walks.
    Character,
    /// A beard on a head that talks.
    Beard,
}

impl DemoScene {
    /// The scene with `overrides` laid over it.
    pub fn scene(self, overrides: &[Override]) -> Result<Scene, SceneError> {
        let text = match self {
            Self::Head => DEFAULT_SCENE,
            Self::Character => CHARACTER_SCENE,
            Self::Beard => BEARD_SCENE,
        };
        Scene::parse(text, Path::new("the built-in scene"), overrides)
    }
}

#[derive(Debug, Args)]
pub struct DemoArgs {
    /// Which scene.
    #[arg(long, value_enum, default_value_t)]
    pub scene: DemoScene,
    #[command(flatten)]
    pub run: RunArgs,
}

/// The options that `demo` and `simulate` share.
#[derive(Debug, Args)]
pub struct RunArgs {
    /// Change one key of the scene, as in `--set solver.ams.k_edge=1e7`. May be repeated; of equal
    /// keys the last one counts.
    #[arg(long = "set", value_name = "KEY=VALUE")]
    pub sets: Vec<String>,
    /// Number of frames, the same as `--set time.frames=N`.
    #[arg(long, value_name = "N", allow_negative_numbers = true)]
    pub frames: Option<i64>,
    /// The processor that runs the simulation.
    #[arg(long, value_enum, default_value_t = Backend::Cpu)]
    pub backend: Backend,
    /// Run STAGE and all later stages on the GPU, and earlier stages on the CPU. Helps to find a
    /// stage that is wrong on the GPU.
    #[arg(long, value_name = "STAGE", value_parser = gpu_stage, conflicts_with = "backend")]
    pub gpu_from: Option<forelock::GpuStage>,
    /// The solver, the same as `--set solver.kind=NAME`.
    #[arg(long, value_name = "NAME")]
    pub solver: Option<String>,
    /// Folder for all output [default: forelock-out/NAME].
    #[arg(long, value_name = "DIR")]
    pub out: Option<PathBuf>,
    /// Name of the cache, the same as `--set output.cache=FILE`. The ending selects the format.
    #[arg(long, value_name = "FILE")]
    pub cache: Option<PathBuf>,
    /// Continue an interrupted or shorter run in the same folder. The result is bit for bit that of
    /// one run.
    #[arg(long)]
    pub resume: bool,
    /// Print only the summary, as one JSON object, on standard output.
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

#[derive(Debug, Args)]
pub struct ShotsArgs {
    /// The list (TOML): `out`, `[set]`, and `[[shot]]` tables with `name`, `scene`, `[set]` and
    /// `[vary]`.
    #[arg(value_name = "LIST")]
    pub list: PathBuf,
    /// Shots at a time [default: one per processor, at most 8].
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..=1024))]
    pub jobs: Option<u16>,
    /// Run this shot only; may be repeated.
    #[arg(long, value_name = "NAME")]
    pub only: Vec<String>,
    /// Run no frames after this one; a later run without it goes on.
    #[arg(long, value_name = "FRAME")]
    pub until: Option<u32>,
    /// Run what is done again.
    #[arg(long)]
    pub again: bool,
    /// Run nothing: list the shots and what is there of them.
    #[arg(long)]
    pub list_only: bool,
    /// Run nothing: write the list as an Open Job Description template, for a render farm.
    #[arg(long, value_name = "FILE", conflicts_with_all = ["jobs", "until", "again", "list_only"])]
    pub openjd: Option<PathBuf>,
    /// With `--openjd`: frames of a step; steps of a shot depend on each other [default: all].
    #[arg(long, value_name = "FRAMES", requires = "openjd", default_value_t = 0)]
    pub chunk: u32,
    /// Print only the results, as one JSON object, on standard output.
    #[arg(long)]
    pub json: bool,
}

#[derive(Debug, Args)]
pub struct TrainArgs {
    /// The configuration (TOML) [default: hair of the built-in head].
    #[arg(value_name = "CONFIG")]
    pub config: Option<PathBuf>,
    /// Change one key of the configuration, as in `--set steps.simulator=2000`; may be repeated.
    #[arg(long = "set", value_name = "KEY=VALUE")]
    pub sets: Vec<String>,
    /// Folder for all output [default: forelock-out/NAME].
    #[arg(long, value_name = "DIR")]
    pub out: Option<PathBuf>,
    /// Continue an interrupted training in the same folder. The model is bit for bit that of one
    /// run.
    #[arg(long)]
    pub resume: bool,
    /// Train nothing: measure this model with the hair and motions that the configuration holds
    /// out. A file or builtin:head.
    #[arg(long, value_name = "MODEL", conflicts_with_all = ["resume", "out"])]
    pub measure: Option<String>,
    /// Print only the summary, as one JSON object, on standard output.
    #[arg(long)]
    pub json: bool,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum Backend {
    /// The CPU.
    Cpu,
    /// A GPU.
    Gpu,
    /// A GPU if there is one that supports the scene, otherwise the CPU.
    Auto,
}

impl RunArgs {
    /// The backend for the options `--backend` and `--gpu-from`.
    pub fn backend(&self) -> forelock::Backend {
        self.gpu_from.map_or_else(|| self.backend.into(), forelock::Backend::GpuFrom)
    }
}

fn gpu_stage(name: &str) -> Result<forelock::GpuStage, String> {
    let all = forelock::GpuStage::all();
    all.iter().copied().find(|stage| stage.name() == name).ok_or_else(|| {
        let names = all.iter().map(|stage| stage.name()).collect::<Vec<_>>().join(", ");
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
    /// A scene file (.toml), a cache written by `simulate`, or a groom.
    #[arg(value_name = "SCENE|CACHE")]
    pub input: PathBuf,
    /// Change one key of the scene, as in `--set camera.yaw_degrees=90`; may be repeated.
    #[arg(long = "set", value_name = "KEY=VALUE")]
    pub sets: Vec<String>,
    /// The picture to write, a .png or .jpg; with `--film` an animated PNG [default: picture.png
    /// beside the input].
    #[arg(short, long, value_name = "FILE")]
    pub out: Option<PathBuf>,
    /// The processor that draws [default: the scene's `output.renderer`].
    #[arg(long, value_enum)]
    pub backend: Option<BenchBackend>,
    /// Frame of the cache [default: the last].
    #[arg(long, value_name = "N")]
    pub frame: Option<usize>,
    /// Draw a film of the whole cache.
    #[arg(long, conflicts_with_all = ["frame", "sheet"])]
    pub film: bool,
    /// Draw a contact sheet: frames over time of a cache, or views from several sides of a groom or
    /// scene.
    #[arg(long, conflicts_with = "frame")]
    pub sheet: bool,
    /// Draw the frames of the cache at these times in seconds, in rows of three, as in
    /// `--at 0,0.5,2`.
    #[arg(long, value_name = "SECS", value_delimiter = ',', conflicts_with_all = ["film", "frame", "sheet"])]
    pub at: Vec<f64>,
}

/// What draws the hair of the window.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum Draw {
    /// The CPU.
    Cpu,
    /// The device of the window, even if it is emulated by the CPU, which takes seconds a picture.
    Gpu,
    /// A graphics card if there is one, otherwise the CPU.
    Auto,
}

#[cfg(feature = "view")]
impl From<Draw> for forelock::Backend {
    fn from(draw: Draw) -> Self {
        match draw {
            Draw::Cpu => Self::Cpu,
            Draw::Gpu => Self::Gpu,
            Draw::Auto => Self::Auto,
        }
    }
}

#[derive(Debug, Args)]
pub struct ViewArgs {
    /// A scene file (.toml), the cache of a run (.npz) or a groom [default: the scene of `demo`,
    /// which plays].
    #[arg(value_name = "SCENE|CACHE|GROOM")]
    pub input: Option<PathBuf>,
    /// Change one key of the scene, as in `--set solver.kind=dftl`; may be repeated.
    #[arg(long = "set", value_name = "KEY=VALUE")]
    pub sets: Vec<String>,
    /// The processor that runs the simulation.
    #[arg(long, value_enum, default_value_t = Backend::Cpu)]
    pub backend: Backend,
    /// The processor that draws the hair.
    #[arg(long, value_enum, default_value_t = Draw::Auto)]
    pub draw: Draw,
    /// Play, write a picture of the window to this file after `--after` seconds, and close it.
    #[arg(long, value_name = "FILE")]
    pub screenshot: Option<PathBuf>,
    /// When the picture is taken.
    #[arg(long, value_name = "SECS", default_value_t = 5.0, requires = "screenshot")]
    pub after: f64,
}

#[derive(Debug, Args)]
pub struct GrowArgs {
    /// The groom to write (.hair, .data, .tfx, .npz, .obj, .abc, .ply, .usda, .usdc, .usd, .glb,
    /// .gltf).
    #[arg(value_name = "FILE", required_unless_present_any = ["sheets", "picture"])]
    pub out: Option<PathBuf>,
    /// The preset to grow. An unknown name lists all presets.
    #[arg(long, default_value = "wavy")]
    pub preset: String,
    /// Number of strands.
    #[arg(long, default_value_t = 10_000)]
    pub strands: u32,
    /// Particles per strand.
    #[arg(long, default_value_t = 25)]
    pub vertices: u32,
    /// Seed of all random numbers.
    #[arg(long, default_value_t = 1)]
    pub seed: u64,
    /// Change one growth parameter, as in `--set wave_radius=0.01`; may be repeated.
    #[arg(long = "set", value_name = "KEY=VALUE")]
    pub sets: Vec<String>,
    /// Also draw a picture, a .png or .jpg.
    #[arg(long, value_name = "FILE")]
    pub picture: Option<PathBuf>,
    /// Write the contact sheets for Figs. 13 and 14 of the AMS paper to this folder.
    #[arg(long, value_name = "DIR")]
    pub sheets: Option<PathBuf>,
    /// Print the result as one JSON object.
    #[arg(long)]
    pub json: bool,
}

#[derive(Debug, Args)]
pub struct GroomArgs {
    /// The script: a scene file (TOML) with `[[edit]]` tables.
    #[arg(value_name = "SCRIPT")]
    pub script: PathBuf,
    /// Change one key of the script, as in `--set edit.0.strength=0.5`. May be repeated; of equal
    /// keys the last one counts.
    #[arg(long = "set", value_name = "KEY=VALUE")]
    pub sets: Vec<String>,
    /// Folder for all output [default: forelock-out/NAME].
    #[arg(long, value_name = "DIR")]
    pub out: Option<PathBuf>,
    /// Also draw a picture after each edit, in the folder `steps`.
    #[arg(long)]
    pub steps: bool,
    /// Print the result as one JSON object.
    #[arg(long)]
    pub json: bool,
}

/// The conversion of the coordinates of a file to metres, y up.
#[derive(Clone, Copy, Debug, Args)]
pub struct ImportArgs {
    /// Unit of length in the file: m, cm, mm or in.
    #[arg(long, default_value = "m", value_parser = parse::<Unit>)]
    pub unit: Unit,
    /// Axis that points up in the file: y or z.
    #[arg(long, default_value = "y", value_parser = parse::<Up>)]
    pub up: Up,
    /// Further factor for all lengths.
    #[arg(long, default_value_t = 1.0, value_parser = positive, allow_negative_numbers = true)]
    pub scale: f64,
}

impl ImportArgs {
    /// The conversion as the library's type.
    pub fn import(self) -> Import {
        Import { unit: self.unit, up: self.up, scale: self.scale }
    }
}

#[derive(Debug, Args)]
pub struct InfoArgs {
    /// The groom, cache, character, motion or TressFX skinning file to describe.
    #[arg(value_name = "FILE")]
    pub file: PathBuf,
    #[command(flatten)]
    pub import: ImportArgs,
    /// Print the result as one JSON object.
    #[arg(long)]
    pub json: bool,
}

#[derive(Debug, Args)]
pub struct ConvertArgs {
    /// The groom to read.
    #[arg(value_name = "IN")]
    pub input: PathBuf,
    /// The groom to write. The ending selects the format.
    #[arg(value_name = "OUT")]
    pub output: PathBuf,
    #[command(flatten)]
    pub import: ImportArgs,
    /// Resample all strands to this number of particles [default: not resampled].
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(2..=1000))]
    pub resample: Option<u32>,
    /// Convert all frames of a cache or an animated file, to .npz, .abc, .usdc, .usd or .glb;
    /// without it the first one.
    #[arg(long, conflicts_with = "resample")]
    pub animated: bool,
    /// Write velocities too, for motion blur.
    #[arg(long, requires = "animated")]
    pub velocities: bool,
    /// Print the result as one JSON object.
    #[arg(long)]
    pub json: bool,
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
    use super::*;

    #[test]
    fn the_readme_s_commands_are_understood() {
        let commands = commands(include_str!("../../../README.md"));
        assert!(commands.len() >= 12, "{commands:?}");
        understand(commands);
    }

    #[test]
    fn the_pages_commands_are_understood() -> std::io::Result<()> {
        let docs = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../docs");
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

    /// Checks that a scene has every key that the command sets.
    fn check_keys(command: &Command) -> Result<(), SceneError> {
        let (prefix, sets) = match command {
            Command::Demo(demo) => ("", &demo.run.sets),
            Command::Simulate(simulate) => ("", &simulate.run.sets),
            Command::Render(render) => ("", &render.sets),
            Command::Grow(grow) => ("groom.grow.", &grow.sets),
            _ => return Ok(()),
        };
        let sets: Result<Vec<_>, _> =
            sets.iter().map(|set| Override::set(&format!("{prefix}{set}"))).collect();
        let scene = if let Command::Demo(demo) = command { demo.scene } else { DemoScene::Head };
        scene.scene(&sets?).map(drop)
    }
}

//! The arguments of `bench`.

use std::path::PathBuf;

use clap::{Args, Subcommand, ValueEnum};
use forelock_bench::paper::{Experiment, Figure, NeuralFigure};

use super::share;

#[derive(Debug, Args)]
pub struct BenchArgs {
    /// The measurement to run.
    #[command(subcommand)]
    pub what: BenchCommand,
}

#[derive(Debug, Subcommand)]
pub enum BenchCommand {
    /// The tables of a paper with our times beside the printed ones, or the measurements of one
    /// figure.
    Paper {
        /// The paper.
        #[arg(long, value_enum, default_value_t = WhichPaper::Ams)]
        paper: WhichPaper,
        /// The figure [default: the tables].
        #[arg(long, long_help = figures_help())]
        figure: Option<String>,
        /// Share of the strands that is grown, above 0 and at most 1.
        #[arg(long, default_value_t = 1.0, value_parser = share, allow_negative_numbers = true)]
        share: f64,
        /// Number of timed frames of each scene of Table 1.
        #[arg(long, value_name = "N", default_value_t = 60, value_parser = clap::value_parser!(u32).range(1..=100_000), conflicts_with = "figure")]
        frames: u32,
        /// Number of frames of each scene before the timed ones.
        #[arg(long, value_name = "N", default_value_t = 30, value_parser = clap::value_parser!(u32).range(0..=100_000), conflicts_with = "figure")]
        warm_up: u32,
        /// Steps of each training, in figures that train. Models are kept, in DIR/models or in
        /// forelock-out/neuralocks, and used again.
        #[arg(long, value_name = "N", default_value_t = 3000, value_parser = clap::value_parser!(u32).range(1..=10_000_000))]
        steps: u32,
        /// The processor that runs the scenes of the tables. Scenes that it cannot run are skipped.
        #[arg(long, value_enum, default_value_t = BenchBackend::Cpu, conflicts_with = "figure")]
        backend: BenchBackend,
        /// Folder for Markdown, JSON, an HTML page and plots [default: print only].
        #[arg(long, value_name = "DIR")]
        out: Option<PathBuf>,
        /// Print one JSON object instead of the table.
        #[arg(long)]
        json: bool,
    },
    /// All solvers on the same five scenes: time, lengths, penetration, shape and energy, with film
    /// strips.
    Solvers {
        /// Share of the strands that is grown, above 0 and at most 1.
        #[arg(long, default_value_t = 1.0, value_parser = share, allow_negative_numbers = true)]
        share: f64,
        /// Folder for Markdown, JSON, an HTML page, plots and film strips [default: print only].
        #[arg(long, value_name = "DIR")]
        out: Option<PathBuf>,
        /// Print one JSON object instead of the table.
        #[arg(long)]
        json: bool,
    },
    /// The time of a picture by a GPU, stage by stage, for three numbers of strands from three
    /// distances, and of the same picture by the CPU.
    Render {
        /// The largest number of strands to draw, out of 10,000, 50,000 and 120,000.
        #[arg(long, value_name = "N", default_value_t = 120_000, value_parser = clap::value_parser!(u32).range(10_000..=120_000))]
        most: u32,
        /// Number of timed pictures for each number of strands and distance.
        #[arg(long, value_name = "N", default_value_t = 20, value_parser = clap::value_parser!(u32).range(1..=10_000))]
        frames: u32,
        /// Width of the picture, pixels.
        #[arg(long, value_name = "PIXELS", default_value_t = 1920, value_parser = clap::value_parser!(u32).range(16..=4096))]
        width: u32,
        /// Height of the picture, pixels.
        #[arg(long, value_name = "PIXELS", default_value_t = 1080, value_parser = clap::value_parser!(u32).range(16..=4096))]
        height: u32,
        /// Folder for Markdown, JSON, an HTML page and the pictures [default: print only].
        #[arg(long, value_name = "DIR")]
        out: Option<PathBuf>,
        /// Print one JSON object instead of the table.
        #[arg(long)]
        json: bool,
    },
    /// The time of a frame for 1,000 to many strands, and the strand solve compared with the peak
    /// rates of the device.
    Scaling {
        /// The processor that runs the simulation.
        #[arg(long, value_enum, default_value_t = BenchBackend::Cpu)]
        backend: BenchBackend,
        /// The largest number of strands to measure, out of 1,000, 10,000, 30,000, 120,000, 400,000
        /// and 1,000,000.
        #[arg(long, value_name = "N", default_value_t = 120_000, value_parser = clap::value_parser!(u32).range(1_000..=1_000_000))]
        most: u32,
        /// Number of timed frames for each number of strands.
        #[arg(long, value_name = "N", default_value_t = 20, value_parser = clap::value_parser!(u32).range(1..=100_000))]
        frames: u32,
        /// Simulate without hair–hair interaction.
        #[arg(long)]
        apart: bool,
        /// Simulate contacts between strands too.
        #[arg(long, conflicts_with = "apart")]
        contacts: bool,
        /// Store the factors of the strand solve in 16 bits, on a GPU.
        #[arg(long)]
        half_factors: bool,
        /// Folder for Markdown, JSON and an HTML page [default: print only].
        #[arg(long, value_name = "DIR")]
        out: Option<PathBuf>,
        /// Print one JSON object instead of the table.
        #[arg(long)]
        json: bool,
    },
}

/// The processor that runs a measurement.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum BenchBackend {
    /// The CPU.
    Cpu,
    /// A GPU.
    Gpu,
}

/// The papers.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum WhichPaper {
    /// Augmented mass-spring, AMS (2025).
    Ams,
    /// Dynamic follow the leader with shape constraints and SPH (2015).
    Dftl,
    /// Neuralocks, the learned simulator (2025).
    Neuralocks,
}

/// A figure that can be rerun.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum PaperFigure {
    /// A table and a picture of each variant.
    Variants(Figure),
    /// Guides beside all strands.
    Guides,
    /// A study of AMS.
    Study(Experiment),
    /// Volume under follow the leader.
    Volume,
    /// A study of the learned simulator.
    Learned(NeuralFigure),
}

/// A figure's paper, its name and what it shows.
struct Known {
    paper: WhichPaper,
    name: &'static str,
    figure: PaperFigure,
    shows: &'static str,
}

/// The figures of all papers.
const FIGURES: [Known; 22] = {
    use PaperFigure::{Guides, Learned, Study, Variants, Volume};
    use WhichPaper::{Ams, Dftl, Neuralocks};
    const fn of(paper: WhichPaper, name: &'static str, figure: PaperFigure, shows: &'static str) -> Known {
        Known { paper, name, figure, shows }
    }
    [
        of(Ams, "4", Variants(Figure::Sag), "the sag of one strand, compared with mass-spring"),
        of(Ams, "5", Variants(Figure::Angular), "the effect of the angular spring on a wisp"),
        of(Ams, "7", Guides, "a hand moves through hair, simulated with guides and with all strands"),
        of(Ams, "8", Study(Experiment::HollowSphere), "a sphere in hair carried by guides or simulated"),
        of(Ams, "9", Study(Experiment::Beard), "a beard, compared with mass-spring"),
        of(Ams, "10", Study(Experiment::RollerCoaster), "the roller-coaster: damage, healing, shape kept"),
        of(Ams, "11", Study(Experiment::Grooming), "a trim, geometric and simulated"),
        of(Ams, "asymmetric", Study(Experiment::Asymmetric), "the asymmetric style of Fig. 1"),
        of(Dftl, "2", Volume, "the effect of hair–hair interaction and of shape constraints"),
        of(Neuralocks, "1", Learned(NeuralFigure::Styles), "one model moves several styles"),
        of(Neuralocks, "3", Learned(NeuralFigure::Style), "the energy of the style (trains)"),
        of(Neuralocks, "4", Learned(NeuralFigure::Adhesion), "rising adhesion (trains)"),
        of(Neuralocks, "5", Learned(NeuralFigure::Supervised), "beside training on drapes (trains)"),
        of(Neuralocks, "6", Learned(NeuralFigure::Locks), "without and with codes of locks (trains)"),
        of(Neuralocks, "7", Learned(NeuralFigure::Transport), "frames carried along a strand"),
        of(Neuralocks, "8", Learned(NeuralFigure::Rigged), "a tiny network for hair on a rig"),
        of(Neuralocks, "9", Learned(NeuralFigure::Xpbd), "the network beside XPBD and AMS"),
        of(Neuralocks, "10", Learned(NeuralFigure::Generalisation), "3,000 and 120,000 strands"),
        of(Neuralocks, "11", Learned(NeuralFigure::Stiffness), "stiffness, beside an older energy"),
        of(Neuralocks, "12", Learned(NeuralFigure::Map), "beside a network for a whole groom (trains)"),
        of(Neuralocks, "13", Learned(NeuralFigure::Unseen), "grooms that were not trained"),
        of(Neuralocks, "ablations", Learned(NeuralFigure::Ablations), "what each part is worth (trains)"),
    ]
};

impl WhichPaper {
    /// Its name on the command line.
    pub fn name(self) -> String {
        self.to_possible_value().map_or_else(String::new, |value| value.get_name().to_owned())
    }
}

impl PaperFigure {
    /// The figure `name` of `paper`.
    ///
    /// # Errors
    /// What is wrong, if there is none.
    pub fn of(paper: WhichPaper, name: &str) -> Result<Self, String> {
        let own = || FIGURES.iter().filter(|known| known.paper == paper);
        if let Some(known) = own().find(|known| known.name == name) {
            return Ok(known.figure);
        }
        if let Some(known) = FIGURES.iter().find(|known| known.name == name) {
            return Err(format!("--figure {name} is of another paper: add --paper {}", known.paper.name()));
        }
        let names: Vec<&str> = own().map(|known| known.name).collect();
        Err(format!("--figure {name} cannot be rerun; of {} these can: {}", paper.name(), names.join(", ")))
    }
}

/// The help of `--figure`.
fn figures_help() -> String {
    let line = |known: &Known| format!("\n- {} {}: {}", known.paper.name(), known.name, known.shows);
    let lines: String = FIGURES.iter().map(line).collect();
    format!("The figure [default: the tables]. Each paper has its own:\n{lines}")
}

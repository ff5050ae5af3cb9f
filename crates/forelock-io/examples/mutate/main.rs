//! Reads damaged files, with every reader of the crate, until one panics or takes too much memory.
//!
//! ```sh
//! cargo run --release -p forelock-io --example mutate -- [--secs 60] [--executions N] [--seed 1]
//!     [--first 0] [--seeds FOLDER] [READER ...]
//! ```
//!
//! Each execution takes a whole file, damages it ([`mutation`]) and reads it. All readers take
//! turns, or those that are named; `--seeds` adds the files of a folder, by their endings. What a
//! reader may take is stated in [`readers::READERS`]: a multiple of the file, and a constant. An
//! execution is determined by the reader, the seed and its number, so a failure is repeated by
//! `--seed S --first N --executions 1 READER`; its file is kept too.

#![expect(clippy::print_stdout, reason = "a program that reports what it found")]

mod memory;
mod mutation;
mod ogawa;
mod readers;
mod seeds;

use std::fs;
use std::panic::{self, AssertUnwindSafe};
use std::path::PathBuf;
use std::process::ExitCode;
use std::sync::Mutex;
use std::time::{Duration, Instant};

use mutation::Random;
use readers::{READERS, Reader};

/// Executions of a reader before the next one has its turn.
const TURN: u64 = 200;
/// An execution that takes longer is a failure.
const SLOW: Duration = Duration::from_secs(5);

/// Where the last panic happened, and its message.
static PANIC: Mutex<String> = Mutex::new(String::new());

struct Arguments {
    secs: f64,
    executions: u64,
    seed: u64,
    first: u64,
    seeds: Option<PathBuf>,
    readers: Vec<&'static Reader>,
}

/// What a reader did so far.
struct Tally {
    reader: &'static Reader,
    seeds: Vec<Vec<u8>>,
    next: u64,
    accepted: u64,
    failures: u64,
    /// The largest share of what it may take.
    share: f64,
    slowest: Duration,
}

fn main() -> ExitCode {
    let arguments = match parse(std::env::args().skip(1)) {
        Ok(arguments) => arguments,
        Err(problem) => {
            println!("error: {problem}");
            return ExitCode::from(2);
        }
    };
    panic::set_hook(Box::new(|info| {
        if let Ok(mut last) = PANIC.lock() {
            *last = info.to_string().replace('\n', " ");
        }
    }));
    let own = |reader: &&'static Reader| Tally {
        reader,
        seeds: seeds::of(reader.name, arguments.seeds.as_deref()),
        next: arguments.first,
        accepted: 0,
        failures: 0,
        share: 0.0,
        slowest: Duration::ZERO,
    };
    let mut tallies: Vec<Tally> = arguments.readers.iter().map(own).collect();
    for tally in tallies.iter_mut().filter(|tally| tally.seeds.is_empty()) {
        println!("{}: no whole files to damage", tally.reader.name);
        tally.failures += 1;
    }
    let begin = Instant::now();
    let end = arguments.first.saturating_add(arguments.executions);
    let is_done = |tally: &Tally| tally.failures > 0 || tally.next >= end;
    while begin.elapsed().as_secs_f64() < arguments.secs && !tallies.iter().all(is_done) {
        for tally in tallies.iter_mut().filter(|tally| !is_done(tally)) {
            for _ in 0..TURN.min(end - tally.next) {
                tally.execute(arguments.seed);
                if tally.failures > 0 {
                    break;
                }
            }
        }
    }
    println!("| reader | files | executions | read | most memory, of its limit | slowest, ms |");
    println!("| --- | --- | --- | --- | --- | --- |");
    for own in &tallies {
        let (name, files, executions) = (own.reader.name, own.seeds.len(), own.next - arguments.first);
        let (share, slowest) = (100.0 * own.share, own.slowest.as_secs_f64() * 1e3);
        println!("| {name} | {files} | {executions} | {} | {share:.0} % | {slowest:.1} |", own.accepted);
    }
    ExitCode::from(u8::from(tallies.iter().any(|tally| tally.failures > 0)))
}

impl Tally {
    /// Damages a file and reads it.
    fn execute(&mut self, seed: u64) {
        let number = self.next;
        self.next += 1;
        let mut random = Random::new(self.reader.name, seed, number);
        let bytes = mutation::damaged(&self.seeds, &mut random);
        let limit = self.reader.times * bytes.len() + self.reader.constant;
        memory::begin(self.reader.name, seed, number);
        let begin = Instant::now();
        let read = panic::catch_unwind(AssertUnwindSafe(|| (self.reader.read)(&bytes)));
        let (mut elapsed, most) = (begin.elapsed(), memory::most());
        if elapsed > SLOW && read.is_ok() {
            // Unless the process was stopped meanwhile, it takes as long again.
            let begin = Instant::now();
            (self.reader.read)(&bytes);
            elapsed = begin.elapsed();
        }
        self.share = self.share.max(most as f64 / limit as f64);
        self.slowest = self.slowest.max(elapsed);
        let problem = match read {
            Err(_) => PANIC.lock().map_or_else(|_| "a panic".to_owned(), |last| last.clone()),
            Ok(_) if most > limit => {
                format!("{most} bytes of memory for a file of {}, over {limit}", bytes.len())
            }
            Ok(_) if elapsed > SLOW => format!("{:.1} s", elapsed.as_secs_f64()),
            Ok(is_read) => {
                self.accepted += u64::from(is_read);
                return;
            }
        };
        self.failures += 1;
        let name = self.reader.name;
        let kept = std::env::temp_dir().join(format!("mutated-{seed}-{number}.{name}"));
        let kept =
            fs::write(&kept, &bytes).map_or_else(|error| error.to_string(), |()| kept.display().to_string());
        println!("{name}, seed {seed}, execution {number}: {problem} ({kept})");
    }
}

fn parse(mut words: impl Iterator<Item = String>) -> Result<Arguments, String> {
    let mut own = Arguments {
        secs: f64::INFINITY,
        executions: u64::MAX,
        seed: 1,
        first: 0,
        seeds: None,
        readers: Vec::new(),
    };
    while let Some(word) = words.next() {
        let mut value = || words.next().ok_or_else(|| format!("{word} needs a value"));
        let whole = |text: String| text.parse::<u64>().map_err(|error| format!("{word} {text}: {error}"));
        match &*word {
            "--secs" => {
                let text = value()?;
                own.secs = text.parse().map_err(|error| format!("{word} {text}: {error}"))?;
            }
            "--executions" => own.executions = whole(value()?)?,
            "--seed" => own.seed = whole(value()?)?,
            "--first" => own.first = whole(value()?)?,
            "--seeds" => own.seeds = Some(value()?.into()),
            name => own.readers.push(READERS.iter().find(|reader| reader.name == name).ok_or_else(|| {
                let known: Vec<&str> = READERS.iter().map(|reader| reader.name).collect();
                format!("{name} is no reader; these are: {}", known.join(" "))
            })?),
        }
    }
    if own.secs.is_infinite() && own.executions == u64::MAX {
        own.secs = 60.0;
    }
    if own.readers.is_empty() {
        own.readers = READERS.iter().collect();
    }
    Ok(own)
}

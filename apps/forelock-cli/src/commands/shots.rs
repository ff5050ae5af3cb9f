//! `shots`: runs a list of shots, each in a process of its own, some at a time.
//!
//! # Practice
//! A shot that fails or crashes costs no other one. What is done is not run again, and what was cut
//! short is resumed, so that the same command goes on after anything. A shot whose folder another
//! process writes, as one that an earlier command left behind when it was killed, waits for it.

use std::collections::VecDeque;
use std::io::{BufRead, BufReader};
use std::path::Path;
use std::process::{Child, Command, ExitCode, Stdio};
use std::sync::atomic::{AtomicU32, Ordering};
use std::sync::{Arc, Mutex, PoisonError};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use anyhow::Context;
use forelock::shots::{Chunks, Row, Shot, ShotList, ShotResult, Standing, openjd, results_page};
use serde::Serialize;

use crate::arguments::ShotsArgs;
use crate::{interrupt, terminal};

/// Time between two looks at the processes.
const LOOK: Duration = Duration::from_millis(50);
/// How long processes may take to end by themselves after an interruption: less than this one has.
const GRACE: Duration = Duration::from_millis(900);
/// Time between two lines of progress.
const TELL: Duration = Duration::from_secs(5);
/// The most shots at a time by default: each has its memory.
const MOST_JOBS: usize = 8;
/// Lines of a process that are kept for the message of a failure.
const KEPT: usize = 5;

/// What a part of a shot does without: its last part makes these files, of all frames.
const OF_THE_WHOLE: [&str; 4] =
    ["output.picture=false", "output.contact_sheet=false", "output.film=false", "output.exports=[]"];

/// Runs the list. Each shot has `threads` threads, by default its share of the processors.
pub fn shots(arguments: &ShotsArgs, threads: Option<u16>) -> anyhow::Result<ExitCode> {
    let list = ShotList::load(&arguments.list)?.only(&arguments.only)?;
    if let Some(path) = &arguments.openjd {
        if std::path::absolute(path)? == std::path::absolute(&arguments.list)? {
            anyhow::bail!("{}: this is the list itself; name another file", path.display());
        }
        let text = openjd(&list, &arguments.list, Chunks { frames: arguments.chunk });
        forelock_io::atomic_write(path, |file| file.write_all(text.as_bytes()))?;
        terminal::line(format!("{}: {} shots", path.display(), list.shots.len()))?;
        return Ok(ExitCode::SUCCESS);
    }
    if arguments.list_only {
        for shot in &list.shots {
            let standing = match shot.standing() {
                Standing::New => "new".to_owned(),
                Standing::Begun => "begun".to_owned(),
                Standing::Done(result) => format!("done, state {}", result.state_hash),
            };
            terminal::line(format!("{}: {standing}", shot.name))?;
        }
        return Ok(ExitCode::SUCCESS);
    }
    interrupt::set_watched(true);
    let outcomes = Runner::new(&list, arguments, threads).run()?;
    interrupt::set_watched(false);
    report(&list, arguments, outcomes)
}

/// What became of a shot.
type Outcome = Result<ShotResult, String>;

/// A process that runs a shot.
struct Job {
    index: usize,
    child: Child,
    /// Frames done, as it told last.
    frame: Arc<AtomicU32>,
    /// The last lines that it printed, and the thread that reads them.
    lines: Arc<Mutex<VecDeque<String>>>,
    reader: Option<JoinHandle<()>>,
}

struct Runner<'a> {
    shots: &'a [Shot],
    arguments: &'a ShotsArgs,
    waiting: VecDeque<usize>,
    running: Vec<Job>,
    outcomes: Vec<Option<Outcome>>,
    jobs: usize,
    threads: usize,
}

impl<'a> Runner<'a> {
    fn new(list: &'a ShotList, arguments: &'a ShotsArgs, threads: Option<u16>) -> Self {
        let processors = std::thread::available_parallelism().map_or(1, usize::from);
        let jobs = arguments.jobs.map_or(processors.min(MOST_JOBS), usize::from).min(list.shots.len());
        let mut outcomes = vec![None; list.shots.len()];
        if !arguments.again {
            for (outcome, shot) in outcomes.iter_mut().zip(&list.shots) {
                if let Standing::Done(result) = shot.standing() {
                    *outcome = Some(Ok(result));
                }
            }
        }
        let waiting = (0..outcomes.len()).filter(|&index| outcomes[index].is_none()).collect();
        let threads = threads.map_or((processors / jobs.max(1)).max(1), usize::from);
        Self { shots: &list.shots, arguments, waiting, running: Vec::new(), outcomes, jobs, threads }
    }

    /// Runs all shots that wait. None of a shot: it was interrupted.
    fn run(mut self) -> anyhow::Result<Vec<Option<Outcome>>> {
        let done = self.outcomes.iter().flatten().count();
        if done > 0 && !self.arguments.json {
            terminal::note(format!("{done} of {} shots are done already", self.shots.len()));
        }
        let mut told = Instant::now();
        let mut stopped: Option<Instant> = None;
        loop {
            let is_stopped = interrupt::asked().load(Ordering::SeqCst);
            if is_stopped && stopped.get_or_insert_with(Instant::now).elapsed() > GRACE {
                // What they have done up to their last checkpoint is kept.
                self.running.iter_mut().for_each(|job| drop(job.child.kill()));
            }
            // Those that cannot start yet wait again, until the next look.
            for _ in 0..self.waiting.len() {
                if is_stopped || self.running.len() >= self.jobs {
                    break;
                }
                let Some(index) = self.waiting.pop_front() else { break };
                if let Err(error) = self.start(index) {
                    self.end(index, Some(Err(format!("{error:#}"))));
                }
            }
            self.collect()?;
            if self.running.is_empty() && (is_stopped || self.waiting.is_empty()) {
                return Ok(self.outcomes);
            }
            if told.elapsed() >= TELL && !self.arguments.json {
                told = Instant::now();
                self.tell();
            }
            std::thread::sleep(LOOK);
        }
    }

    /// Starts a shot, if its folder is free; else it waits on.
    fn start(&mut self, index: usize) -> anyhow::Result<()> {
        let shot = &self.shots[index];
        if forelock::is_running_in(&shot.folder) {
            self.waiting.push_back(index);
            return Ok(());
        }
        let standing = if self.arguments.again { Standing::New } else { shot.standing() };
        if let Standing::Done(result) = standing {
            // Another process has run it meanwhile.
            self.end(index, Some(Ok(result)));
            return Ok(());
        }
        let goes_on = standing == Standing::Begun;
        shot.prepare(goes_on)?;
        let program = std::env::current_exe().context("the program does not find itself")?;
        let mut command = Command::new(program);
        command.arg("simulate").arg(shot.scene_file()).arg("--out").arg(&shot.folder);
        command.args(["--threads", &self.threads.to_string()]);
        if goes_on {
            command.arg("--resume");
        }
        if let Some(until) = self.arguments.until {
            command.args(["--frames", &until.min(shot.scene.time.frames).to_string()]);
            if until < shot.scene.time.frames {
                command.args(OF_THE_WHOLE.iter().flat_map(|own| ["--set", own]));
            }
        }
        let child = command.stdin(Stdio::null()).stdout(Stdio::null()).stderr(Stdio::piped()).spawn();
        let mut child = child.with_context(|| format!("the process of {} cannot start", shot.name))?;
        let (frame, lines) = (Arc::<AtomicU32>::default(), Arc::<Mutex<VecDeque<String>>>::default());
        let reader = child.stderr.take().map(|errors| {
            let (frame, lines) = (frame.clone(), lines.clone());
            std::thread::spawn(move || {
                for line in BufReader::new(errors).lines().map_while(Result::ok) {
                    if let Some(done) = line.strip_prefix("simulating ").and_then(|own| own.split('/').next())
                    {
                        frame.store(done.parse().unwrap_or(0), Ordering::Relaxed);
                    }
                    let mut lines = lines.lock().unwrap_or_else(PoisonError::into_inner);
                    lines.push_back(line);
                    if lines.len() > KEPT {
                        lines.pop_front();
                    }
                }
            })
        });
        self.running.push(Job { index, child, frame, lines, reader });
        Ok(())
    }

    /// Takes the outcomes of processes that have ended.
    fn collect(&mut self) -> anyhow::Result<()> {
        let mut at = 0;
        while at < self.running.len() {
            let Some(status) = self.running[at].child.try_wait()? else {
                at += 1;
                continue;
            };
            let Job { index, lines, reader, .. } = self.running.swap_remove(at);
            // A panic of the thread has been printed.
            let _ = reader.map(JoinHandle::join);
            let shot = &self.shots[index];
            let lines = lines.lock().unwrap_or_else(PoisonError::into_inner);
            let outcome = match shot.result() {
                Some(result) if status.success() => Some(Ok(result)),
                _ if interrupt::asked().load(Ordering::SeqCst) => None,
                _ => {
                    let error = lines.iter().rev().find_map(|line| line.strip_prefix("error: "));
                    Some(Err(error.map_or_else(|| format!("the process ended with {status}"), str::to_owned)))
                }
            };
            if matches!(outcome, Some(Err(_))) && forelock::is_running_in(&shot.folder) {
                // Another process was quicker.
                self.waiting.push_back(index);
            } else {
                self.end(index, outcome);
            }
        }
        Ok(())
    }

    /// Notes what became of a shot.
    fn end(&mut self, index: usize, outcome: Option<Outcome>) {
        if let (Some(outcome), false) = (&outcome, self.arguments.json) {
            let told = match outcome {
                Ok(result) => format!("{} frames, {:.1} ms each", result.frames, result.ms_per_frame()),
                Err(error) => format!("failed: {error}"),
            };
            terminal::note(format!("{}: {told}", self.shots[index].name));
        }
        self.outcomes[index] = outcome;
    }

    /// One line of what runs.
    fn tell(&self) {
        let done = self.outcomes.iter().flatten().count();
        let running = self.running.iter().map(|job| {
            let shot = &self.shots[job.index];
            format!("{} {}/{}", shot.name, job.frame.load(Ordering::Relaxed), shot.scene.time.frames)
        });
        let running: Vec<String> = running.collect();
        terminal::note(format!("{done} of {} shots done; {}", self.shots.len(), running.join(", ")));
    }
}

#[derive(Serialize)]
struct Report<'a> {
    list: &'a str,
    done: usize,
    failed: usize,
    shots: Vec<ShotReport<'a>>,
}

#[derive(Serialize)]
struct ShotReport<'a> {
    name: &'a str,
    folder: &'a Path,
    frames: Option<u32>,
    state_hash: Option<String>,
    error: Option<String>,
}

/// Writes the page of results and prints them.
fn report(
    list: &ShotList,
    arguments: &ShotsArgs,
    outcomes: Vec<Option<Outcome>>,
) -> anyhow::Result<ExitCode> {
    let is_cut = outcomes.iter().any(Option::is_none);
    let told = outcomes.into_iter().map(|own| own.unwrap_or_else(|| Err("interrupted".to_owned())));
    let rows = list.shots.iter().zip(told).map(|(shot, outcome)| Row { shot, outcome });
    let rows: Vec<Row<'_>> = rows.collect();
    // Of a part of the list there is no page: another process may run the rest.
    if arguments.only.is_empty() {
        let page = list.out.join("index.html");
        let text = results_page(&list.name, &rows);
        forelock_io::atomic_write(&page, |file| file.write_all(text.as_bytes()))?;
        if !arguments.json {
            terminal::line(page.display().to_string())?;
        }
    }
    let done = rows.iter().filter(|row| row.outcome.is_ok()).count();
    let failed = rows.len() - done;
    if arguments.json {
        let shots = rows.iter().map(|row| {
            let found = row.outcome.as_ref();
            ShotReport {
                name: &row.shot.name,
                folder: &row.shot.folder,
                frames: found.ok().map(|own| own.frames),
                state_hash: found.ok().map(|own| own.state_hash.clone()),
                error: found.err().cloned(),
            }
        });
        terminal::json(&Report { list: &list.name, done, failed, shots: shots.collect() })?;
    } else {
        for row in &rows {
            terminal::line(match &row.outcome {
                Ok(own) => format!("{}: {} frames, state {}", row.shot.name, own.frames, own.state_hash),
                Err(error) => format!("{}: {error}", row.shot.name),
            })?;
        }
        let goes_on = if failed > 0 { "; the same command runs the rest" } else { "" };
        terminal::note(format!("{done} of {} shots are done{goes_on}", rows.len()));
    }
    Ok(match (is_cut, failed) {
        (true, _) => ExitCode::from(interrupt::STATUS),
        (false, 0) => ExitCode::SUCCESS,
        _ => ExitCode::FAILURE,
    })
}

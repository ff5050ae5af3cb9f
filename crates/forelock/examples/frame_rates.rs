//! Measures how much hair depends on the frame rate: tips of the same motion at several frame
//! rates, compared with those at 60 frames a second at equal times. `frame_rates [KEY=VALUE…]`
//! prints a table's rows; the keys are laid over every scene.
#![expect(clippy::print_stdout, reason = "a program for developers")]

use forelock::scene::Override;

#[path = "../tests/it/frame_rates/mod.rs"]
mod frame_rates;

/// Frames a second.
const RATES: [u32; 6] = [24, 30, 50, 120, 144, 240];

/// Duration of each run, seconds.
const SECS: u32 = 2;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let sets: Result<Vec<_>, _> = std::env::args().skip(1).map(|set| Override::set(&set)).collect();
    let sets = sets?;
    println!("| hair | motion | frames a second | tips, mean | tips, worst |");
    println!("| --- | --- | --- | --- | --- |");
    for hair in &frame_rates::HAIR {
        for motion in &frame_rates::MOTIONS {
            let reference = frame_rates::run(hair, motion, 60, SECS, &sets)?;
            for fps in RATES {
                let run = frame_rates::run(hair, motion, fps, SECS, &sets)?;
                let apart = frame_rates::apart(&reference, &run);
                let [mean, worst] = [apart.mean, apart.worst].map(|share| share * 1e2);
                println!("| {} | {} | {fps} | {mean:.4} % | {worst:.4} % |", hair.name, motion.name);
            }
        }
    }
    Ok(())
}

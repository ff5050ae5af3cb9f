//! Times inference of the network: `cargo run --release -p forelock-neural --example time_network`.

#![expect(clippy::print_stdout, reason = "its results")]

use forelock_core::lane::Simd;
use forelock_core::lane::peak::multiply_adds_per_sec;
use forelock_neural::PARTICLES;
use forelock_neural::network::inference::Predictor;
use forelock_neural::network::rotation::basis;
use forelock_neural::network::{Network, SHARED, STATICS, Shape};
use forelock_neural::random::Random;
use std::error::Error;
use std::time::Instant;

fn main() -> Result<(), Box<dyn Error>> {
    let shape = Shape::default();
    let mut random = Random::new(1);
    let mut numbers =
        |count: usize| -> Vec<f32> { (0..count).map(|_| 0.1 * random.signed() as f32).collect() };
    let network = Network::new(shape, numbers(shape.parameters()))?;
    let predictor = Predictor::new(&network, &basis(100.0, 1e-4, 1.0 / 30.0), Simd::Auto)?;
    let shared = numbers(SHARED);
    println!("{} threads, instruction set {:?}", rayon::current_num_threads(), Simd::Auto.resolve());
    for count in [3_000, 10_000, 50_000, 120_000] {
        let strand = std::array::from_fn(|i| [0.0, 0.5 * i as f32, 0.0]);
        let prepared = predictor.prepare(&vec![strand; count], &numbers(count * STATICS))?;
        let mut out = vec![[[0.0; 3]; PARTICLES]; count];
        let (mut times, before) = (Vec::new(), multiply_adds_per_sec());
        for _ in 0..40 {
            let began = Instant::now();
            predictor.predict(&prepared, &shared, &mut out);
            times.push(began.elapsed().as_secs_f64());
        }
        let peak = before.max(multiply_adds_per_sec()) * rayon::current_num_threads() as f64;
        times.sort_by(f64::total_cmp);
        let operations = (count * shape.operations_per_strand() + shape.operations_per_frame()) as f64;
        let share = |secs: f64| 100.0 * operations / secs / peak;
        println!(
            "{count:7} strands: least {:.2} ms ({:.0} % of the peak of all threads), median {:.2} ms ({:.0} %)",
            1e3 * times[0],
            share(times[0]),
            1e3 * times[20],
            share(times[20]),
        );
    }
    Ok(())
}

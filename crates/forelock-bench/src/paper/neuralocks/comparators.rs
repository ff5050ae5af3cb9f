//! Fig. 5: another way to train the network.
//!
//! # Limitations
//! Neither code nor data of GroomGen (2023) are public. What runs here is built after its
//! description in the paper, with our inputs, strands and body, and is called GroomGen-like.

use forelock::{Observer, html};
use forelock_neural::train::{DRAPED, MOMENTS, STRANDS};

use super::NeuralOptions;
use super::ablations::{QUASI_STATIC, scores, show, steps, train};
use super::models::{SCORES, Variant};
use crate::BenchError;
use crate::paper::study::Study;

/// The static strand network, trained by squared error on drapes.
const GROOMGEN_LIKE: Variant = Variant {
    name: "drapes",
    label: "GroomGen-like",
    keys: &["method.kind=quasi-static", "method.objective=drapes"],
};

/// Fig. 5: the same static network, trained by energies and by squared error on drapes.
pub(super) fn supervised(options: &NeuralOptions, observer: &mut Observer<'_>) -> Result<Study, BenchError> {
    let trained = train(&[QUASI_STATIC, GROOMGEN_LIKE], options, observer)?;
    let table = scores(&trained, options, observer)?;
    let strip = show(&trained, "straight", options, &mut |_, _, _| {}, observer)?;
    Ok(Study {
        title: "Neuralocks, Fig. 5: beside training on drapes (GroomGen-like)".to_owned(),
        claim: "GroomGen needs simulated data, is quasi-static, and leaves more hair inside the body."
            .to_owned(),
        notes: vec![
            steps(options),
            format!(
                "Both are the static strand network of 100 inputs, so they take the same time. The \
                 GroomGen-like one lowers the squared error beside {} drapes, which are computed once; \
                 ours lowers the energies of any pose that is drawn. The reference is the drape at \
                 every frame, without inertia.",
                html::thousands(DRAPED * MOMENTS * STRANDS)
            ),
            "In our run of 3,000 steps the paper's claim of hair inside the body held, but the \
             GroomGen-like network came nearer to the drapes than ours."
                .to_owned(),
            SCORES.to_owned(),
            "Neither code nor data of GroomGen are public: this is a network after its description, with \
             our inputs."
                .to_owned(),
        ],
        tables: vec![table],
        strips: vec![strip],
        ..Study::default()
    })
}

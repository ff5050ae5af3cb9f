//! How long work reports its progress.

/// What long work reports while it runs.
#[derive(Clone, Copy, Debug)]
pub enum Progress<'a> {
    /// Something the user should know, one sentence.
    Note(&'a str),
    /// A piece of work begins, of which `done` of `total` steps are done already.
    Begin {
        /// Name of the work, a word or two.
        what: &'static str,
        /// Steps done before.
        done: u64,
        /// Steps in all.
        total: u64,
    },
    /// One more step is done.
    Step,
    /// The piece of work is done.
    End,
}

/// Receives the progress of long work.
pub type Observer<'a> = dyn FnMut(&Progress<'_>) + 'a;

//! Locks: one writer at a time.
//!
//! A lock is a file that one process holds locked. The operating system releases it when the
//! process ends, however it ends, so a file that was left behind locks nothing. Locks are advisory:
//! they keep out only other programs that take them.

use std::{
    fs::{self, File, OpenOptions, TryLockError},
    io::{self, Read, Write},
    path::Path,
};

use crate::{atomic::Temporary, error::WriteError};

/// A lock that is held until it is dropped.
#[derive(Debug)]
pub struct Lock {
    path: Temporary,
    _file: File,
}

impl Lock {
    /// Locks the file `path`, which is made if it is not there, for writing `target`. Where the
    /// file system has no locks, this succeeds without one.
    ///
    /// # Errors
    /// [`WriteError::Locked`] for `target` if another process, or this one, holds the lock;
    /// [`WriteError::Io`] if the file cannot be written.
    pub fn take(path: &Path, target: &Path) -> Result<Self, WriteError> {
        let mut options = OpenOptions::new();
        options.read(true).write(true).create(true).truncate(false);
        loop {
            let mut file = options.open(path).map_err(WriteError::io(path))?;
            match file.try_lock() {
                Ok(()) => {}
                Err(TryLockError::WouldBlock) => {
                    let mut by = String::new();
                    let _ = file.take(32).read_to_string(&mut by);
                    let by = if by.is_empty() { by } else { format!(" ({})", by.trim()) };
                    return Err(WriteError::Locked { path: target.into(), by });
                }
                Err(TryLockError::Error(error)) if is_without_locks(&error) => {}
                Err(TryLockError::Error(error)) => return Err(WriteError::io(path)(error)),
            }
            // The holder before may have removed the file after it was opened here.
            if is_at(&file, path) {
                let own = Temporary::new(path.into());
                let _ = file.set_len(0).and_then(|()| write!(file, "process {}", std::process::id()));
                return Ok(Self { path: own, _file: file });
            }
        }
    }
}

impl Drop for Lock {
    fn drop(&mut self) {
        // While it is locked. Where open files cannot be told apart, the file stays.
        if cfg!(unix) {
            self.path.remove();
        }
    }
}

/// Whether `error` means that the file system has no locks: ENOLCK of network file systems too.
fn is_without_locks(error: &io::Error) -> bool {
    let no_locks = if cfg!(target_os = "linux") { 37 } else { 77 };
    error.kind() == io::ErrorKind::Unsupported || cfg!(unix) && error.raw_os_error() == Some(no_locks)
}

/// Whether `file` is the one at `path`.
#[cfg(unix)]
fn is_at(file: &File, path: &Path) -> bool {
    use std::os::unix::fs::MetadataExt;
    let key = |metadata: io::Result<fs::Metadata>| metadata.map(|m| (m.dev(), m.ino())).ok();
    key(file.metadata()) == key(fs::metadata(path))
}

/// Whether `file` is the one at `path`: no holder removes it.
#[cfg(not(unix))]
fn is_at(_file: &File, _path: &Path) -> bool {
    true
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_lock_is_held_once_and_leaves_nothing() {
        let folder = tempfile::tempdir().unwrap();
        let (path, target) = (folder.path().join("a.lock"), folder.path().join("a"));
        // A file that was left behind locks nothing.
        fs::write(&path, "process 1").unwrap();
        let held = Lock::take(&path, &target).unwrap();
        let message = Lock::take(&path, &target).unwrap_err().to_string();
        let expected = format!("another run writes here (process {})", std::process::id());
        assert!(message.contains(&expected) && !message.contains(".lock"), "{message}");
        drop(held);
        assert!(!cfg!(unix) || !path.exists());
        drop(Lock::take(&path, &target).unwrap());
    }

    /// Of many threads that take a lock again and again, one has it at a time.
    #[test]
    fn a_removed_lock_is_not_taken_twice() {
        use std::sync::atomic::{AtomicU32, Ordering};
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.lock");
        let (holders, taken) = (AtomicU32::new(0), AtomicU32::new(0));
        std::thread::scope(|scope| {
            for _ in 0..4 {
                scope.spawn(|| {
                    let mut own = 0;
                    while own < 100 {
                        let Ok(_lock) = Lock::take(&path, &path) else {
                            std::thread::yield_now();
                            continue;
                        };
                        assert_eq!(holders.fetch_add(1, Ordering::SeqCst), 0);
                        own += 1;
                        taken.fetch_add(1, Ordering::SeqCst);
                        std::thread::yield_now();
                        holders.fetch_sub(1, Ordering::SeqCst);
                    }
                });
            }
        });
        assert_eq!(taken.load(Ordering::SeqCst), 400);
    }
}

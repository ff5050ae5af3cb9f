//! How much memory is free, so that what cannot fit is refused before it is allocated.
//!
//! # Practice
//! [`check`] compares what is about to be allocated with what the machine has. On Linux that is
//! `MemAvailable` of `/proc/meminfo`, or less where a control group or `ulimit -v` limits the
//! process. Elsewhere the allocator is asked.
//!
//! # Limitations
//! The figures are lower bounds: what passes may still not fit, and other programs may take the
//! memory in between.

use std::fmt;

/// Something needs more memory than is free.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{what} needs {needed} of memory{}: {remedy}", free_words(*.free))]
pub struct MemoryError {
    /// What needs it.
    pub what: &'static str,
    /// How much it needs at least.
    pub needed: Bytes,
    /// How much is free, if that is known.
    pub free: Option<Bytes>,
    /// What to do.
    pub remedy: &'static str,
}

/// A number of bytes, written with a unit.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct Bytes(pub u64);

impl fmt::Display for Bytes {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let mut value = self.0 as f64;
        for unit in ["bytes", "kB", "MB", "GB", "TB"] {
            if value < 999.5 || unit == "TB" {
                let decimals = usize::from(value < 9.95 && unit != "bytes");
                return write!(f, "{value:.decimals$} {unit}");
            }
            value /= 1000.0;
        }
        Ok(())
    }
}

fn free_words(free: Option<Bytes>) -> String {
    free.map_or_else(|| ", more than there is".to_owned(), |free| format!(", {free} are free"))
}

/// Checks that `count` times `each` bytes are free for `what`; `remedy` says what to do if not.
///
/// # Errors
/// [`MemoryError`] if they are not.
pub fn check(what: &'static str, count: u64, each: u64, remedy: &'static str) -> Result<(), MemoryError> {
    let needed = count.saturating_mul(each);
    // Reading the figures of the system takes longer than a small allocation.
    if needed < 1 << 24 {
        return Ok(());
    }
    let free = free();
    let fits = match free {
        Some(free) => needed <= free,
        None => usize::try_from(needed).is_ok_and(|bytes| Vec::<u8>::new().try_reserve_exact(bytes).is_ok()),
    };
    if fits {
        return Ok(());
    }
    Err(MemoryError { what, needed: Bytes(needed), free: free.map(Bytes), remedy })
}

/// Memory that can be allocated without swapping, bytes; `None` where the system does not say.
fn free() -> Option<u64> {
    let read = |path: &str| std::fs::read_to_string(path).ok();
    let available = available(&read("/proc/meminfo")?)?;
    let groups = read("/proc/self/cgroup").unwrap_or_default();
    let limits = group_folders(&groups).into_iter().filter_map(|folder| {
        let number = |name: &str| read(&format!("{folder}/{name}"))?.trim().parse::<u64>().ok();
        // The files of version 2, then those of version 1; without a limit the first says "max".
        let limit = number("memory.max").or_else(|| number("memory.limit_in_bytes"))?;
        let used = number("memory.current").or_else(|| number("memory.usage_in_bytes"))?;
        // What is cached of files is given back when it is needed.
        let cached = read(&format!("{folder}/memory.stat")).and_then(|stat| field(&stat, "inactive_file "));
        Some(limit.saturating_sub(used.saturating_sub(cached.unwrap_or(0))))
    });
    let limit = read("/proc/self/limits").and_then(|limits| field(&limits, "Max address space"));
    let used = || field(&read("/proc/self/status")?, "VmSize:");
    let room = limit.map(|limit| limit.saturating_sub(1024 * used().unwrap_or(0)));
    Some(limits.chain(room).fold(available, u64::min))
}

/// `MemAvailable` of the text of `/proc/meminfo`, bytes.
fn available(meminfo: &str) -> Option<u64> {
    field(meminfo, "MemAvailable:").map(|kilobytes| kilobytes * 1024)
}

/// The number after `name` at the start of a line.
fn field(text: &str, name: &str) -> Option<u64> {
    let rest = text.lines().find_map(|line| line.strip_prefix(name))?;
    rest.split_whitespace().next()?.parse().ok()
}

/// The folders of the control groups that the text of `/proc/self/cgroup` names, and of all groups
/// around them.
fn group_folders(groups: &str) -> Vec<String> {
    let mut folders = Vec::new();
    for line in groups.lines() {
        let mut parts = line.splitn(3, ':').skip(1);
        let root = match parts.next() {
            Some("") => "/sys/fs/cgroup",
            Some(names) if names.split(',').any(|name| name == "memory") => "/sys/fs/cgroup/memory",
            _ => continue,
        };
        let path = parts.next().unwrap_or_default().trim_end_matches('/');
        let ends = path.match_indices('/').map(|(end, _)| end).chain([path.len()]);
        folders.extend(ends.map(|end| format!("{root}{}", &path[..end])));
    }
    folders
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_too_large_is_refused_in_words() {
        let error = check("a test", u64::MAX, 2, "ask for less").unwrap_err();
        let message = error.to_string();
        assert!(message.starts_with("a test needs 18446744 TB of memory, "), "{message}");
        assert!(message.ends_with(": ask for less"), "{message}");
        check("a test", 1 << 20, 1 << 5, "ask for less").unwrap();
        let free = Some(Bytes(22_400_000_000));
        let error = MemoryError { needed: Bytes(1_234_000_000_000), free, ..error };
        assert_eq!(error.to_string(), "a test needs 1.2 TB of memory, 22 GB are free: ask for less");
        assert_eq!(Bytes(999_600).to_string(), "1.0 MB");
    }

    #[test]
    fn the_figures_of_linux_are_read() {
        let text = "MemTotal:       24680000 kB\nMemAvailable:   23000000 kB\n";
        assert_eq!(available(text), Some(23_000_000 * 1024));
        assert_eq!(field("anon 5\ninactive_file 4096\n", "inactive_file "), Some(4096));
        assert_eq!(
            group_folders("12:cpu,memory:/a\n3:pids:/a\n0::/user/own\n"),
            [
                "/sys/fs/cgroup/memory",
                "/sys/fs/cgroup/memory/a",
                "/sys/fs/cgroup",
                "/sys/fs/cgroup/user",
                "/sys/fs/cgroup/user/own"
            ]
        );
        if cfg!(target_os = "linux") {
            assert!(free().is_some_and(|bytes| bytes > 1 << 24));
        }
    }
}

//! The checks of `cargo xtask floors`: dependencies, file sizes, signatures, comments and solvers.

mod crates;
mod files;
mod layout;
mod modules;
mod signatures;
mod solvers;
mod source;

use std::path::Path;

/// A rule for the whole repository.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Check {
    /// Crates depend only on crates of lower floors.
    Crates,
    /// Modules of the core use only modules of lower floors.
    Modules,
    /// No source file is too long.
    Lines,
    /// No function takes an anonymous tuple apart.
    Signatures,
    /// No comment of a source file is too wide.
    Comments,
    /// No page, and no comment of a scene file or script, is too wide.
    Pages,
    /// Few files name a built-in solver.
    Solvers,
}

const ALL: [Check; 7] = [
    Check::Crates,
    Check::Modules,
    Check::Lines,
    Check::Signatures,
    Check::Comments,
    Check::Pages,
    Check::Solvers,
];

/// Checks that the repository does not pass yet. A check of this list that passes is a fault, so
/// that the list only becomes shorter.
const NOT_YET: &[Check] = &[];

/// What the checks found.
#[derive(Debug, Default, PartialEq)]
pub struct Findings {
    /// What must be changed, a sentence each.
    pub faults: Vec<String>,
    /// What the checks of [`NOT_YET`] found. It does not fail the command.
    pub not_yet: Vec<String>,
}

/// Runs all checks in the repository at `root`.
///
/// # Errors
/// If a file cannot be read.
pub fn check(root: &Path) -> anyhow::Result<Findings> {
    let sources = files::sources(root)?;
    let mut findings = Findings::default();
    for check in ALL {
        let found = match check {
            Check::Crates => crates::check(root),
            Check::Modules => modules::check(root),
            Check::Lines => Ok(layout::check_lines(&sources)),
            Check::Signatures => Ok(signatures::check(&sources)),
            Check::Comments => Ok(layout::check_comments(&sources)),
            Check::Pages => layout::check_pages(root),
            Check::Solvers => solvers::solver_files(root),
        };
        findings.add(check, NOT_YET.contains(&check), found)?;
    }
    Ok(findings)
}

impl Findings {
    fn add(&mut self, check: Check, not_yet: bool, found: anyhow::Result<Vec<String>>) -> anyhow::Result<()> {
        match found {
            Ok(found) if !not_yet => self.faults.extend(found),
            Ok(found) if found.is_empty() => {
                self.faults.push(format!("the check {check:?} passes; remove it from NOT_YET"));
            }
            Ok(found) => self.not_yet.extend(found),
            // A table that is still missing.
            Err(error) if not_yet => self.not_yet.push(format!("{error:#}")),
            Err(error) => return Err(error),
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn this_repository_passes() -> anyhow::Result<()> {
        assert_eq!(check(&crate::root()?)?.faults, Vec::<String>::new());
        Ok(())
    }

    #[test]
    fn a_postponed_check_must_fail() -> anyhow::Result<()> {
        let fault = || vec!["fault".to_owned()];
        let mut findings = Findings::default();
        findings.add(Check::Lines, true, Ok(fault()))?;
        findings.add(Check::Lines, true, Err(anyhow::anyhow!("fault")))?;
        assert_eq!(findings, Findings { faults: vec![], not_yet: [fault(), fault()].concat() });
        findings.add(Check::Lines, true, Ok(vec![]))?;
        assert!(findings.faults[0].contains("Lines passes"), "{findings:?}");

        let mut findings = Findings::default();
        findings.add(Check::Lines, false, Ok(fault()))?;
        assert_eq!(findings, Findings { faults: fault(), not_yet: vec![] });
        assert!(findings.add(Check::Lines, false, Err(anyhow::anyhow!("fault"))).is_err());
        Ok(())
    }
}

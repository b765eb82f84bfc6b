//! How a command that did not succeed ends: message, machine-readable code and exit status.

use super::console::Console;
use super::interrupt;
use lightkiln::bake::BakeError;
use lightkiln::import::ImportError;
use std::process::ExitCode;

/// Exit status by kind of failure. Part of the command line's contract.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Status {
    /// The input or the arguments' meaning is at fault.
    Failed = 1,
    /// The arguments cannot be understood.
    Usage = 2,
    /// The machine is at fault: threads, folders, disk.
    Environment = 3,
    /// The user stopped it.
    Interrupted = 130,
}

/// Exit status of a command that the user stopped.
pub(crate) const INTERRUPTED: i32 = Status::Interrupted as i32;

/// Why a command did not succeed.
#[derive(Debug)]
pub(crate) struct Failure {
    status: Status,
    code: &'static str,
    error: anyhow::Error,
}

impl Failure {
    /// The machine is at fault.
    pub(crate) fn environment(code: &'static str, error: anyhow::Error) -> Self {
        Self { status: Status::Environment, code, error }
    }

    /// Tells the user and returns the process's status.
    pub(crate) fn report(&self, console: &Console) -> ExitCode {
        match self.status {
            Status::Interrupted => interrupt::announce(console),
            _ => console.error(self.code, &format!("{:#}", self.error)),
        }
        ExitCode::from(self.status as u8)
    }
}

impl From<BakeError> for Failure {
    fn from(error: BakeError) -> Self {
        let status = match &error {
            BakeError::Cancelled(_) => Status::Interrupted,
            BakeError::Output(e) if e.is_environment() => Status::Environment,
            BakeError::Part(e) if e.is_environment() => Status::Environment,
            _ => Status::Failed,
        };
        Self { status, code: error.code(), error: error.into() }
    }
}

impl From<ImportError> for Failure {
    fn from(error: ImportError) -> Self {
        BakeError::from(error).into()
    }
}

/// Shows what is wrong with the arguments, or the help that they ask for.
pub(crate) fn usage(error: &clap::Error) -> ExitCode {
    // Nobody is left to tell if the terminal is gone.
    let _ = error.print();
    if !error.use_stderr() {
        return ExitCode::SUCCESS;
    }
    if std::env::args().any(|a| a == "--json") {
        let message = error.to_string();
        let line = message.lines().next().unwrap_or_default();
        Console::json().event_error("usage", line.strip_prefix("error: ").unwrap_or(line));
    }
    ExitCode::from(Status::Usage as u8)
}

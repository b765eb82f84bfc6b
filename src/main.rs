//! The command `lightkiln`: what was typed in, files and messages out. Everything else is the library's.

mod cli;

use clap::Parser;
use cli::args::{Arguments, Command};
use cli::console::Console;
use cli::{bake, failure, info, interrupt, relight, tiles};
use std::process::ExitCode;

fn main() -> ExitCode {
    let command = match Arguments::try_parse() {
        Ok(arguments) => arguments.command,
        Err(error) => return failure::usage(&error),
    };
    let console = Console::new(command.speech());
    let cancelled = interrupt::listen(console);
    let done = cli::start_threads(command.threads()).and_then(|()| match &command {
        Command::Bake(options) => bake::run(options, console, cancelled),
        Command::Relight(options) => relight::run(options, console, cancelled),
        Command::Info(options) => info::run(options, console, cancelled),
        Command::Solve(options) => tiles::solve(options, console, cancelled),
        Command::Gather(options) => tiles::gather(options, console, cancelled),
        Command::Merge(options) => tiles::merge(options, console, cancelled),
    });
    match done {
        Ok(()) => ExitCode::SUCCESS,
        Err(failure) => failure.report(&console),
    }
}

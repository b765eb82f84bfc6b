//! What the user sees: text on the standard error, JSON lines on the standard output.

use super::options::SpeechArguments;
use lightkiln::output::Report;
use lightkiln::warning::Warning;
use serde_json::{Value, json};
use std::io::{self, IsTerminal, Write};
use std::path::Path;

/// Where messages go and which of them.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Console {
    json: bool,
    quiet: bool,
    /// True if the standard error is watched by a person.
    terminal: bool,
}

impl Console {
    /// As the user asked for. Sets up the log that `--verbose` shows, too.
    pub(crate) fn new(speech: SpeechArguments) -> Self {
        if speech.verbose {
            let log = tracing_subscriber::fmt().with_writer(io::stderr).with_target(false);
            log.with_max_level(tracing::Level::DEBUG).init();
        }
        Self { json: speech.json, quiet: speech.quiet, terminal: io::stderr().is_terminal() }
    }

    /// JSON lines and no text.
    pub(crate) fn json() -> Self {
        Self { json: true, quiet: true, terminal: false }
    }

    /// True if progress is wanted as JSON lines.
    pub(crate) fn is_json(&self) -> bool {
        self.json
    }

    /// True if a person watches.
    pub(crate) fn is_watched(&self) -> bool {
        self.terminal && !self.quiet && !self.json
    }

    /// One JSON line, if they are wanted, at once.
    pub(crate) fn event(&self, event: &Value) {
        if self.json {
            print_line(&event.to_string());
        }
    }

    /// The last JSON line of a bake or of relighting: where the results are, and the report.
    pub(crate) fn result(&self, folder: &Path, report: &Report) {
        let path = |name: &String| folder.join(name).display().to_string();
        self.event(&json!({
            "event": "result",
            "folder": folder.display().to_string(),
            "outputs": report.outputs.iter().map(path).collect::<Vec<_>>(),
            "report": report,
        }));
    }

    /// Text for people, if they want it.
    pub(crate) fn say(&self, text: &str) {
        if !self.quiet {
            // A closed standard error leaves nobody to tell.
            let _ = writeln!(io::stderr(), "{text}");
        }
    }

    /// A fault that the work goes on after.
    pub(crate) fn warn(&self, warning: &Warning) {
        self.event(&json!({
            "event": "warning", "code": warning.code, "place": warning.place, "message": warning.message
        }));
        self.say(&format!("warning: {warning}"));
    }

    /// The end of the work. Text is shown even to those who want none.
    pub(crate) fn error(&self, code: &str, message: &str) {
        self.event_error(code, message);
        let _ = writeln!(io::stderr(), "error: {message}");
    }

    /// The JSON line of an error.
    pub(crate) fn event_error(&self, code: &str, message: &str) {
        self.event(&json!({ "event": "error", "code": code, "message": message }));
    }
}

/// Prints on the standard output. A reader that went away is no reason to fail: the files still get written.
pub(crate) fn print_line(line: &str) {
    let mut out = io::stdout().lock();
    let _ = writeln!(out, "{line}").and_then(|()| out.flush());
}

//! `report.html`: the report for people, one file without references to others.

use super::heat::heat_map;
use super::report::Report;
use super::thumbnail::{png, thumbnail};
use crate::atlas::PageImage;
use crate::audit::{Audit, Estimate, ObjectFigure, Verdict};
use base64::Engine as _;
use base64::prelude::BASE64_STANDARD;
use std::fmt::Write as _;
use std::io::{self, Write};

/// Most objects that the table of errors lists.
const MOST_OBJECTS: usize = 20;

/// Writes the page: `report`'s facts and a thumbnail of each of `pages`.
pub fn write_html(sink: &mut dyn Write, report: &Report, pages: &[PageImage]) -> io::Result<()> {
    let mut body = String::new();
    let title = escape(&report.scene.name);
    let _ =
        write!(body, "<h1>{title}</h1><p class=sub>lightkiln {} · {}</p>", report.version, escape(&report.scene.file));
    body += "<div class=pages>";
    for (page, facts) in pages.iter().zip(&report.atlas.pages) {
        let _ = write!(
            body,
            "<figure><img alt=\"{0}\" src=\"data:image/png;base64,{1}\"><figcaption>{0} · {2}×{3} · {4} texels</figcaption></figure>",
            escape(&facts.file),
            BASE64_STANDARD.encode(png(&thumbnail(page))?),
            facts.width,
            facts.height,
            facts.texels
        );
    }
    body += "</div>";
    if let Some(audit) = &report.audit {
        body += &errors(audit, pages)?;
    }
    body += &tables(report);
    writeln!(
        sink,
        "<!doctype html><html lang=en><meta charset=utf-8><meta name=viewport content=\"width=device-width\">\
         <title>{title}</title><style>{STYLE}</style>{body}</html>"
    )
}

const STYLE: &str = "body{font:15px/1.5 system-ui,sans-serif;max-width:70rem;margin:2rem auto;padding:0 1rem;\
color:#222;background:#fafafa}h1{margin:0}.sub{color:#777;margin:0 0 1rem}.pages{display:flex;flex-wrap:wrap;gap:1rem}\
figure{margin:0}img{display:block;max-width:100%;background:#000;image-rendering:pixelated}figcaption{color:#777;\
font-size:13px}table{border-collapse:collapse;margin:.3rem 0 1.2rem}td{padding:.15rem 1.2rem .15rem 0;\
border-bottom:1px solid #ddd}td+td{font-variant-numeric:tabular-nums}";

/// What the audit found: figures, the worst objects, and a picture of every page.
fn errors(audit: &Audit, pages: &[PageImage]) -> io::Result<String> {
    let verdict = match audit.verdict {
        Verdict::Met => "met",
        Verdict::Missed => "missed",
        Verdict::Uncertain => "not certain",
    };
    let share = |share: Option<f64>| share.map_or_else(|| "below the noise of the audit".into(), percent);
    let mut out = table(
        "Error",
        &[
            ("target", format!("{}: {verdict}", percent(audit.target))),
            ("error", interval(&audit.error)),
            ("bias", interval(&audit.bias)),
            ("median of texels", share(audit.median)),
            ("95th percentile", share(audit.p95)),
            (
                "audited",
                format!("{} of {} texels, {} paths each", audit.audited, audit.population, audit.paths_per_texel),
            ),
        ],
    );
    out += "<div class=pages>";
    for (index, page) in pages.iter().enumerate() {
        let picture = BASE64_STANDARD.encode(heat_map(page, index, audit)?);
        let _ = write!(out, "<figure><img alt=\"errors\" src=\"data:image/png;base64,{picture}\"></figure>");
    }
    out += "</div><p class=sub>Audited texels, off by less than the target (green) to ten times as much (red), beside \
            the mean irradiance, as far as noise lets tell.</p>";
    let row = |o: &ObjectFigure| {
        let text = format!(
            "{:.0} % of the squared error; error {}, bias {}",
            100.0 * o.share,
            interval(&o.error),
            interval(&o.bias)
        );
        (o.path.clone(), text)
    };
    let rows: Vec<_> = audit.objects.iter().take(MOST_OBJECTS).map(row).collect();
    let rows: Vec<_> = rows.iter().map(|(path, text)| (path.as_str(), text.clone())).collect();
    Ok(out + &table("Objects by their share of the error", &rows))
}

/// A share as a percentage.
fn percent(share: f64) -> String {
    format!("{:.2} %", 100.0 * share)
}

fn interval(e: &Estimate) -> String {
    format!("{} ({} to {})", percent(e.value), percent(e.low), percent(e.high))
}

/// The facts as tables.
fn tables(report: &Report) -> String {
    let count = |n: usize| n.to_string();
    let scene = &report.scene;
    let mut state = vec![
        ("reached", report.state.reached.name().to_owned()),
        ("error to expect", percent(report.state.predicted_error)),
    ];
    for r in &report.refinements {
        let text = format!(
            "{} of the texels again, aiming for {}; the error had been {}",
            percent(r.texels),
            percent(r.aim),
            interval(&r.error_before)
        );
        state.push(("gathered", text));
    }
    let mut out = table("State", &state);
    out += &table(
        "Scene",
        &[
            ("meshes", count(scene.meshes)),
            ("instances", count(scene.instances)),
            ("triangles", count(scene.triangles)),
            ("lights", count(scene.lights)),
            ("textures", count(scene.textures)),
            ("charts", count(report.atlas.charts)),
            ("texels", count(report.atlas.texels)),
            ("unwrapped by", report.atlas.unwrapper.clone()),
        ],
    );
    if let Some(relight) = &report.relight {
        let mut rows: Vec<_> = relight.changes.iter().map(|change| ("changed", change.clone())).collect();
        rows.push(("error to be expected of changed reflectances", percent(relight.expected_error)));
        out += &table("Relit", &rows);
    }
    let groups: Vec<_> = report.groups.iter().map(|g| (g.name.as_str(), g.lights.join(", "))).collect();
    if !groups.is_empty() {
        out += &table("Light groups", &groups);
    }
    let settings: Vec<_> = report.settings.iter().map(|(k, v)| (k.as_str(), plain(v))).collect();
    out += &table("Settings", &settings);
    let seconds = |d: super::report::Duration| match d.cpu_s {
        Some(cpu) => format!("{:.2} s ({cpu:.2} s of processor time)", d.wall_s),
        None => format!("{:.2} s", d.wall_s),
    };
    let mut times: Vec<_> = report.stages.iter().map(|s| (s.stage, seconds(s.duration))).collect();
    times.push(("total", seconds(report.total)));
    out += &table("Time", &times);
    let mut effort: Vec<_> = report.rays.iter().map(|(kind, n)| (format!("rays, {kind}"), n.to_string())).collect();
    effort.push(("nodes".into(), report.solver.nodes.to_string()));
    effort.push(("elements".into(), report.solver.elements.to_string()));
    effort.push(("links".into(), report.solver.links.to_string()));
    effort.push(("iterations".into(), report.solver.iterations.to_string()));
    effort.push(("probes".into(), report.solver.probes.to_string()));
    if let Some(bytes) = report.memory_peak_bytes {
        effort.push(("peak memory".into(), format!("{:.0} MB", bytes as f64 / 1e6)));
    }
    let effort: Vec<_> = effort.iter().map(|(k, v)| (k.as_str(), v.clone())).collect();
    out += &table("Effort", &effort);
    let warnings: Vec<_> = report.warnings.iter().map(|w| (w.place.as_str(), w.message.clone())).collect();
    if !warnings.is_empty() {
        out += &table("Warnings", &warnings);
    }
    out
}

fn table(heading: &str, rows: &[(&str, String)]) -> String {
    let mut out = format!("<h2>{heading}</h2><table>");
    for (name, value) in rows {
        let _ = write!(out, "<tr><td>{}<td>{}", escape(name), escape(value));
    }
    out + "</table>"
}

/// A JSON value without the quotes of a string.
fn plain(value: &serde_json::Value) -> String {
    value.as_str().map_or_else(|| value.to_string(), str::to_owned)
}

fn escape(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;").replace('"', "&quot;")
}

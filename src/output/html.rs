//! `report.html`: the report for people, one file without references to others.

use super::report::Report;
use crate::atlas::PageImage;
use crate::scene::Rgb;
use image::{ExtendedColorType, ImageEncoder, codecs::png::PngEncoder};
use std::fmt::Write as _;
use std::io::{self, Write};

/// Longest side of a thumbnail, pixels.
const THUMBNAIL: u32 = 384;

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
            base64(&thumbnail(page)?),
            facts.width,
            facts.height,
            facts.texels
        );
    }
    body += "</div>";
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

/// The facts as tables.
fn tables(report: &Report) -> String {
    let count = |n: usize| n.to_string();
    let scene = &report.scene;
    let mut out = table(
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

/// A small tone-mapped PNG of a page; texels that no chart covers stay dark.
fn thumbnail(page: &PageImage) -> io::Result<Vec<u8>> {
    let step = page.width.max(page.height).div_ceil(THUMBNAIL).max(1);
    let (width, height) = (page.width.div_ceil(step).max(1), page.height.div_ceil(step).max(1));
    let key = middle(page);
    let mut pixels = Vec::with_capacity(width as usize * height as usize * 3);
    for y in 0..height {
        for x in 0..width {
            let block = block_mean(page, x * step, y * step, step);
            pixels.extend(block.to_array().map(|c| tone_map(c / key)));
        }
    }
    let mut png = Vec::new();
    let encoder = PngEncoder::new(&mut png);
    encoder.write_image(&pixels, width, height, ExtendedColorType::Rgb8).map_err(io::Error::other)?;
    Ok(png)
}

/// Mean channel value of the valid texels, or one for a black page.
fn middle(page: &PageImage) -> f32 {
    let valid = || page.rgb.iter().zip(&page.valid).filter(|(_, v)| **v);
    let sum: f64 = valid().map(|(c, _)| f64::from(c.element_sum()) / 3.0).sum();
    let mean = (sum / valid().count().max(1) as f64) as f32;
    if mean > 0.0 { mean } else { 1.0 }
}

/// Mean of the valid texels in a square of `size`.
fn block_mean(page: &PageImage, x0: u32, y0: u32, size: u32) -> Rgb {
    let (mut sum, mut n) = (Rgb::ZERO, 0.0);
    for y in y0..(y0 + size).min(page.height) {
        for x in x0..(x0 + size).min(page.width) {
            let i = y as usize * page.width as usize + x as usize;
            if page.valid[i] {
                sum += page.rgb[i];
                n += 1.0;
            }
        }
    }
    sum / f32::max(n, 1.0)
}

/// Reinhard's curve and the sRGB transfer function.
fn tone_map(c: f32) -> u8 {
    let c = (c / (1.0 + c)).clamp(0.0, 1.0);
    let srgb = if c <= 0.003_130_8 { 12.92 * c } else { 1.055 * c.powf(1.0 / 2.4) - 0.055 };
    (srgb * 255.0).round() as u8
}

/// RFC 4648.
fn base64(bytes: &[u8]) -> String {
    const ALPHABET: &[u8; 64] = b"ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
    let mut out = String::with_capacity(bytes.len().div_ceil(3) * 4);
    for chunk in bytes.chunks(3) {
        let group = chunk.iter().fold(0u32, |g, &b| g << 8 | u32::from(b)) << (8 * (3 - chunk.len()));
        for i in 0..4 {
            let letter = ALPHABET[(group >> (18 - 6 * i)) as usize & 63] as char;
            out.push(if i <= chunk.len() { letter } else { '=' });
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn base64_follows_the_rfcs_vectors() {
        for (plain, coded) in [("", ""), ("f", "Zg=="), ("fo", "Zm8="), ("foo", "Zm9v"), ("foobar", "Zm9vYmFy")] {
            assert_eq!(base64(plain.as_bytes()), coded);
        }
    }

    #[test]
    fn a_thumbnail_is_small_and_ignores_invalid_texels() {
        let mut page = PageImage::black(1000, 500);
        page.rgb[0] = Rgb::splat(1e30);
        page.rgb[1] = Rgb::ONE;
        page.valid[1] = true;
        let png =
            image::load_from_memory(&thumbnail(&page).expect("memory takes everything")).expect("a PNG").into_rgb8();
        assert!(png.width() <= THUMBNAIL && png.height() <= THUMBNAIL);
        assert_eq!(png.get_pixel(0, 0).0, [tone_map(1.0); 3]);
    }
}

//! Throughput of ray queries in a procedural scene, millions of rays per second on one thread.
//!
//! `cargo bench --bench rays` compares vector and portable instructions with the crate `obvhs`; with `--features embree`
//! (Debian's `libembree-dev`) Embree comes first and all ratios are to it. Times are processor times, the best of
//! several interleaved rounds, so that other load on the machine matters little. An argument sets the detail of the scene
//! (1 is about 430,000 triangles, which grow with its square).

mod atrium;
mod cwbvh;
#[cfg(feature = "embree")]
mod embree;

use atrium::{SIZE, atrium};
use glam::Vec3;
use lightkiln::accel::{Accel, Ray, offset_origin};
use std::hint::black_box;
use std::time::Instant;

/// Rays per set.
const RAYS: usize = 1 << 15;
/// Rounds of which the best counts.
const ROUNDS: usize = 7;

/// A small reproducible generator of numbers in 0..1 (Steele et al., SplitMix64).
struct Random(u64);

impl Random {
    fn next(&mut self) -> f32 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let z = (self.0 ^ (self.0 >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        let z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        ((z ^ (z >> 31)) >> 40) as f32 / (1u64 << 24) as f32
    }

    fn sphere(&mut self) -> Vec3 {
        let (z, phi) = (2.0 * self.next() - 1.0, std::f32::consts::TAU * self.next());
        let r = (1.0 - z * z).sqrt();
        Vec3::new(r * phi.cos(), r * phi.sin(), z)
    }
}

/// Rays of one kind.
struct RaySet {
    name: &'static str,
    /// True to ask for any hit, false for the nearest.
    any: bool,
    rays: Vec<Ray>,
}

/// A surface point, offset, and the normal on its near side.
type Point = (Vec3, Vec3);

fn ray_sets(accel: &Accel) -> Vec<RaySet> {
    let mut random = Random(1);
    let primary = camera_rays();
    let points: Vec<Point> = primary.iter().filter_map(|ray| surface_point(accel, ray)).collect();
    let point = |i: usize| points[i * points.len() / RAYS];
    let free = |origin, direction, t_max| Ray { origin, direction, t_min: 0.0, t_max };
    let cosine = |random: &mut Random, (p, n): Point| free(p, (n + 0.999 * random.sphere()).normalize(), f32::INFINITY);
    let bounce: Vec<Ray> = (0..RAYS).map(|i| cosine(&mut random, point(i))).collect();
    let short: Vec<Ray> =
        (0..RAYS).map(|i| Ray { t_max: 0.3 + random.next(), ..cosine(&mut random, point(i)) }).collect();
    let mut shuffled = bounce.clone();
    for i in (1..RAYS).rev() {
        shuffled.swap(i, (random.next() * (i + 1) as f32) as usize % (i + 1));
    }
    // Sources lie where bounced rays arrive: in all of the hall, not only where the camera looks.
    let sources: Vec<Point> = shuffled.iter().filter_map(|ray| surface_point(accel, ray)).collect();
    let between = |a: Point, b: Vec3| {
        let way = b - a.0;
        free(a.0, way.normalize(), way.length())
    };
    let pairs = (0..RAYS).map(|i| between(point(i), sources[i % sources.len()].0)).collect();
    // Eight points of one tile look at eight points of one element.
    let tiles = (0..RAYS)
        .map(|i| {
            let (p, n) = point(i / 8 * 8);
            let jitter = random.sphere();
            between(
                (p + 0.2 * (jitter - n * n.dot(jitter)), n),
                sources[i / 8 % sources.len()].0 + 0.2 * random.sphere(),
            )
        })
        .collect();
    vec![
        RaySet { name: "primary", any: false, rays: primary },
        RaySet { name: "bounce", any: false, rays: bounce },
        RaySet { name: "shuffled", any: false, rays: shuffled },
        RaySet { name: "short", any: true, rays: short },
        RaySet { name: "pairs", any: true, rays: pairs },
        RaySet { name: "tiles", any: true, rays: tiles },
    ]
}

fn camera_rays() -> Vec<Ray> {
    let (width, height) = (512, RAYS / 512);
    let pixels = (0..RAYS).map(|i| (i % width, i / width));
    let direction = |(x, y)| {
        let u = (x as f32 + 0.5) / width as f32 - 0.5;
        let v = (y as f32 + 0.5) / height as f32 - 0.5;
        Vec3::new(1.0, -1.1 * v + 0.05, 2.0 * u).normalize()
    };
    let origin = Vec3::new(-0.47 * SIZE.x, 0.45 * SIZE.y, 0.07 * SIZE.z);
    pixels.map(|p| Ray { origin, direction: direction(p), t_min: 0.0, t_max: f32::INFINITY }).collect()
}

fn surface_point(accel: &Accel, ray: &Ray) -> Option<Point> {
    let hit = accel.closest(ray)?;
    let normal = if hit.normal.dot(ray.direction) < 0.0 { hit.normal } else { -hit.normal };
    Some((offset_origin(ray.origin + ray.direction * hit.t, normal), normal))
}

/// Something that answers a whole set and returns the number of hits.
struct Contender<'a> {
    name: &'static str,
    trace: Box<dyn Fn(&RaySet) -> usize + 'a>,
}

fn contender<'a>(
    name: &'static str,
    closest: impl Fn(&Ray) -> bool + 'a,
    occluded: impl Fn(&Ray) -> bool + 'a,
) -> Contender<'a> {
    let trace = move |set: &RaySet| {
        if set.any {
            set.rays.iter().filter(|ray| occluded(ray)).count()
        } else {
            set.rays.iter().filter(|ray| closest(ray)).count()
        }
    };
    Contender { name, trace: Box::new(trace) }
}

fn timed<T>(what: &str, build: impl FnOnce() -> T) -> T {
    let start = Instant::now();
    let built = build();
    println!("{what:12} built in {:.2} s", start.elapsed().as_secs_f64());
    built
}

/// Processor time of this thread, seconds.
#[cfg(target_os = "linux")]
fn seconds() -> f64 {
    let mut time = libc::timespec { tv_sec: 0, tv_nsec: 0 };
    // SAFETY: the call only writes to `time`.
    unsafe { libc::clock_gettime(libc::CLOCK_THREAD_CPUTIME_ID, &mut time) };
    time.tv_sec as f64 + time.tv_nsec as f64 * 1e-9
}

/// Time since the first call, seconds.
#[cfg(not(target_os = "linux"))]
fn seconds() -> f64 {
    static START: std::sync::LazyLock<Instant> = std::sync::LazyLock::new(Instant::now);
    START.elapsed().as_secs_f64()
}

fn main() {
    let detail = std::env::args().skip(1).find_map(|a| a.parse().ok()).unwrap_or(1.0);
    let scene = atrium(detail);
    println!("{} triangles, {RAYS} rays of each kind", scene.triangle_count());
    let accel = timed("lightkiln", || Accel::build(&scene));
    println!("{:12} {:.1} bytes per triangle", "", accel.size() as f64 / scene.triangle_count() as f64);
    let portable = Accel::build(&scene).portable();
    let cwbvh = timed("obvhs", || cwbvh::Cwbvh::build(&scene));
    #[cfg(feature = "embree")]
    let embree = timed("embree", || embree::Embree::build(&scene));
    let contenders = [
        #[cfg(feature = "embree")]
        contender("embree", |ray| embree.closest(ray).is_some(), |ray| embree.occluded(ray)),
        contender("lightkiln", |ray| accel.closest(ray).is_some(), |ray| accel.occluded(ray)),
        contender("portable", |ray| portable.closest(ray).is_some(), |ray| portable.occluded(ray)),
        contender("obvhs", |ray| cwbvh.closest(ray), |ray| cwbvh.occluded(ray)),
    ];
    report(&contenders, &ray_sets(&accel));
}

/// Times every contender on every set, and prints throughput and the ratio to the first.
fn report(contenders: &[Contender], sets: &[RaySet]) {
    let mut best = vec![vec![f64::INFINITY; sets.len()]; contenders.len()];
    let mut hits = vec![vec![0; sets.len()]; contenders.len()];
    for _ in 0..ROUNDS {
        for (s, set) in sets.iter().enumerate() {
            for (c, contender) in contenders.iter().enumerate() {
                // The first pass brings the contender's data back into the cache.
                for _ in 0..3 {
                    let start = seconds();
                    hits[c][s] = black_box((contender.trace)(set));
                    best[c][s] = best[c][s].min(seconds() - start);
                }
            }
        }
    }
    let row = |name: &str, cell: &dyn Fn(usize) -> String| {
        let cells: String = (0..sets.len()).map(|s| format!("{:>16}", cell(s))).collect();
        println!("{name:12}{cells}");
    };
    row("Mray/s", &|s| sets[s].name.into());
    for (c, contender) in contenders.iter().enumerate() {
        row(contender.name, &|s| format!("{:.2} ({:4.2})", RAYS as f64 / best[c][s] * 1e-6, best[0][s] / best[c][s]));
    }
    for (c, contender) in contenders.iter().enumerate() {
        row(contender.name, &|s| format!("{} hits", hits[c][s]));
    }
}

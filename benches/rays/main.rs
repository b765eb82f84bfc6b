//! Throughput of ray queries in a procedural scene, millions of rays per second on one thread.
//!
//! `cargo bench --bench rays` compares the builders and instruction sets; with `--features embree` (Debian's
//! `libembree-dev`) also Embree, as a ratio. Every figure is the best of several interleaved rounds, so that other load on
//! the machine matters little. An argument sets the detail of the scene (1 is about 350,000 triangles).

mod atrium;
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
const ROUNDS: usize = 15;

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
    let mut point = |i: usize| points[i * points.len() / RAYS];
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
    // Eight neighbours look at eight points of one small patch.
    let tiles =
        (0..RAYS).map(|i| between(point(i), sources[i / 8 % sources.len()].0 + 0.1 * random.sphere())).collect();
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

fn count(set: &RaySet, closest: impl Fn(&Ray) -> bool, occluded: impl Fn(&Ray) -> bool) -> usize {
    if set.any {
        set.rays.iter().filter(|ray| occluded(ray)).count()
    } else {
        set.rays.iter().filter(|ray| closest(ray)).count()
    }
}

fn ours<'a>(name: &'static str, accel: &'a Accel) -> Contender<'a> {
    let trace = |set: &RaySet| count(set, |ray| accel.closest(ray).is_some(), |ray| accel.occluded(ray));
    Contender { name, trace: Box::new(trace) }
}

fn timed<T>(what: &str, build: impl FnOnce() -> T) -> T {
    let start = Instant::now();
    let built = build();
    println!("{what:12} built in {:.2} s", start.elapsed().as_secs_f64());
    built
}

/// Processor time of this thread, seconds.
fn cpu_seconds() -> f64 {
    #[repr(C)]
    struct Timespec {
        seconds: i64,
        nanoseconds: i64,
    }
    unsafe extern "C" {
        fn clock_gettime(clock: i32, time: *mut Timespec) -> i32;
    }
    const THREAD_CPU_TIME: i32 = 3;
    let mut time = Timespec { seconds: 0, nanoseconds: 0 };
    // SAFETY: the structure is that of 64-bit Linux, and the call only writes to it.
    unsafe { clock_gettime(THREAD_CPU_TIME, &mut time) };
    time.seconds as f64 + time.nanoseconds as f64 * 1e-9
}

fn main() {
    let detail = std::env::args().skip(1).find_map(|a| a.parse().ok()).unwrap_or(1.0);
    let scene = atrium(detail);
    println!("{} triangles", scene.triangle_count());
    let accel = timed("default", || Accel::build(&scene));
    println!("{:12} {:.1} bytes per triangle", "", accel.size() as f64 / scene.triangle_count() as f64);
    let portable = timed("portable", || Accel::build(&scene).portable());
    #[cfg(feature = "embree")]
    let embree = timed("embree", || embree::Embree::build(&scene));
    let mut contenders = Vec::new();
    #[cfg(feature = "embree")]
    contenders.push(Contender {
        name: "embree",
        trace: Box::new(|set: &RaySet| count(set, |ray| embree.closest(ray).is_some(), |ray| embree.occluded(ray))),
    });
    contenders.extend([ours("default", &accel)]);

    let sets = ray_sets(&accel);
    print!("{:12}", "Mray/s");
    sets.iter().for_each(|set| print!("{:>16}", set.name));
    println!();
    let mut best = vec![vec![f64::INFINITY; sets.len()]; contenders.len()];
    let mut hits = vec![vec![0; sets.len()]; contenders.len()];
    for _ in 0..ROUNDS {
        for (s, set) in sets.iter().enumerate() {
            for (c, contender) in contenders.iter().enumerate() {
                for _ in 0..3 {
                    let start = cpu_seconds();
                    hits[c][s] = black_box((contender.trace)(set));
                    best[c][s] = best[c][s].min(cpu_seconds() - start);
                }
            }
        }
    }
    for (c, contender) in contenders.iter().enumerate() {
        print!("{:12}", contender.name);
        for s in 0..sets.len() {
            print!("{:9.2} ({:4.2})", RAYS as f64 / best[c][s] * 1e-6, best[0][s] / best[c][s]);
        }
        println!();
    }
    for (s, set) in sets.iter().enumerate() {
        println!("{:12} hits {:?}", set.name, hits.iter().map(|h| h[s]).collect::<Vec<_>>());
    }
}

//! The audit: its paths against closed forms, and its figures against lightmaps whose error is known.

use super::rooms::{Baked, Face, Room, laid_out, sphere};
use super::{cube, grey};
use glam::Vec3;
use lightkiln::accel::Accel;
use lightkiln::atlas::{Atlas, Texels};
use lightkiln::audit::{Audit, AuditSettings, ESTIMATES, Effort, Tracer, Verdict, audit};
use lightkiln::math::{hash2, unit_float};
use lightkiln::progress::{Cancelled, Progress, Silent, Stage};
use lightkiln::scene::{Environment, Rgb, Scene};
use std::f32::consts::PI;
use std::sync::atomic::{AtomicU32, Ordering};

/// Standard errors by which a mean of paths may miss: estimates of few paths are not normally distributed.
const DEVIATIONS: f32 = 7.0;

/// Mean and standard error of estimates.
fn summed(estimates: &[f32]) -> (f32, f32) {
    let n = estimates.len() as f32;
    let mean = estimates.iter().sum::<f32>() / n;
    let squares: f32 = estimates.iter().map(|e| (e - mean).powi(2)).sum();
    (mean, (squares / (n * (n - 1.0))).sqrt())
}

/// Holds the paths at some of `texels` against what is `wanted` there (green channel): each within its noise and
/// `tolerance`, and all together.
pub(crate) fn check_paths(scene: &Scene, b: &Baked, texels: &[usize], tolerance: f32, wanted: impl Fn(usize) -> f32) {
    let accel = Accel::build(scene);
    let tracer = Tracer::new(&accel, &b.atlas, &b.texels, 11);
    let chosen: Vec<usize> = texels.iter().copied().step_by((texels.len() / 40).max(1)).collect();
    let most = chosen.iter().map(|&t| wanted(t)).fold(0.0, f32::max);
    let (mut got, mut want) = ([0.0; ESTIMATES], 0.0);
    for &t in &chosen {
        let estimates = tracer.estimates(t as u32, 128).map(|e| e.y);
        let ((mean, error), target) = (summed(&estimates), wanted(t));
        let slack = tolerance * target.max(0.3 * most) + DEVIATIONS * error;
        assert!((mean - target).abs() <= slack, "{mean} ± {error} instead of {target} at {}", b.texels.position[t]);
        (0..ESTIMATES).for_each(|k| got[k] += estimates[k]);
        want += target;
    }
    let (mean, error) = summed(&got);
    let slack = 0.005 * want + DEVIATIONS * error;
    assert!((mean - want).abs() <= slack, "{mean} ± {error} instead of {want} over {} texels", chosen.len());
}

/// As [`check_paths`] for a scene whose irradiance is the same everywhere.
fn check_uniform(scene: &Scene, texels_per_metre: f32, want: f32) {
    let (atlas, texels) = laid_out(scene, texels_per_metre);
    let b = Baked { atlas, texels, light: Default::default() };
    check_paths(scene, &b, &(0..b.texels.len()).collect::<Vec<_>>(), 0.002, |_| want);
}

#[test]
fn furnaces_are_unbiased() {
    for reflectance in [0.5, 0.8] {
        check_uniform(&cube([grey(1.0, reflectance); 6]), 16.0, PI / (1.0 - reflectance));
    }
    check_uniform(&sphere(12, |_| grey(1.0, 0.5)), 6.0, 2.0 * PI);
    // Nothing to draw: the same furnace by its sky alone.
    let mut room = Room::default();
    room.quad(Vec3::ZERO, Vec3::Z, Vec3::X, grey(0.0, 0.5));
    let sky = Environment::Constant(Rgb::ONE);
    check_uniform(&Scene { environment: sky, ..room.scene() }, 8.0, PI);
}

#[test]
fn a_sphere_of_any_walls_is_unbiased() {
    let face = |d: Vec3| if d.y > 0.0 { grey(1.0, 0.8) } else { grey(0.2, 0.3) };
    check_uniform(&sphere(24, face), 6.0, PI * 0.6 / (1.0 - 0.55));
}

/// A furnace with its texels, whose irradiance is 2π everywhere.
struct Furnace {
    scene: Scene,
    atlas: Atlas,
    texels: Texels,
}

impl Furnace {
    fn new() -> Self {
        let scene = cube([grey(1.0, 0.5); 6]);
        let (atlas, texels) = laid_out(&scene, 40.0);
        Self { scene, atlas, texels }
    }

    /// Audits the lightmap that has 2π times `factor` at every texel.
    fn audit(&self, factor: impl Fn(u32) -> f32, target: f32, most_rays: u64) -> Audit {
        let baked: Vec<Rgb> = (0..self.texels.len() as u32).map(|t| Rgb::splat(2.0 * PI * factor(t))).collect();
        let usable = vec![true; baked.len()];
        let settings = AuditSettings { target, most_rays, seed: 3 };
        let accel = Accel::build(&self.scene);
        audit(&accel, &self.atlas, &self.texels, &usable, &baked, &settings, &Silent)
            .expect("nobody cancels")
            .expect("there are texels")
    }
}

/// Noise of mean 0 and deviation 1.
fn noise(t: u32) -> f32 {
    3f32.sqrt() * (2.0 * unit_float(hash2(t, 5)) - 1.0)
}

#[test]
fn known_errors_are_found() {
    let furnace = Furnace::new();
    let bright = furnace.audit(|_| 1.05, 0.02, 10_000_000);
    assert!(bright.error.low <= 0.05 && 0.05 <= bright.error.high, "{:?}", bright.error);
    assert!(bright.bias.low <= 0.05 && 0.05 <= bright.bias.high, "{:?}", bright.bias);
    assert!(bright.error.high - bright.error.low < 0.02, "{:?}", bright.error);
    assert_eq!(bright.verdict, Verdict::Missed);

    let noisy = furnace.audit(|t| 1.0 + 0.03 * noise(t), 0.05, 10_000_000);
    assert!(noisy.error.low <= 0.03 && 0.03 <= noisy.error.high, "{:?}", noisy.error);
    assert!((noisy.error.value / 0.03 - 1.0).abs() < 0.3, "{:?}", noisy.error);
    assert!(noisy.bias.low <= 0.0 && 0.0 <= noisy.bias.high, "{:?}", noisy.bias);
    assert_eq!(noisy.verdict, Verdict::Met);

    let exact = furnace.audit(|_| 1.0, 0.02, 10_000_000);
    assert!(exact.error.low == 0.0 && exact.error.high < 0.02, "{:?}", exact.error);
    assert_eq!(exact.verdict, Verdict::Met);
}

#[test]
fn objects_and_charts_tell_where_the_error_is() {
    let furnace = Furnace::new();
    let wrong = furnace.atlas.charts.len() as u32 - 1;
    let chart = |t: u32| furnace.texels.chart[t as usize];
    let found = furnace.audit(|t| if chart(t) == wrong { 1.3 } else { 1.0 }, 0.02, 10_000_000);
    let charts = found.charts(&furnace.texels);
    let worst = charts.iter().max_by(|a, b| a.1.0.total_cmp(&b.1.0)).expect("charts were audited");
    assert_eq!(*worst.0, wrong, "{charts:?}");
    let total: f64 = charts.values().map(|c| c.0).sum();
    assert!((total.sqrt() / found.error.value - 1.0).abs() < 1e-3, "{total} and {:?}", found.error);
    assert_eq!(found.objects[0].path, "Room");
    let largest = found.errors().max_by(|a, b| a.1.total_cmp(&b.1)).expect("texels were audited");
    assert_eq!(chart(largest.0.texel), wrong);
}

#[test]
fn a_larger_budget_narrows_the_interval_and_undoes_no_verdict() {
    let furnace = Furnace::new();
    let mut narrower = 0;
    for (error, target) in [(0.0, 0.001), (0.004, 0.001), (0.03, 0.03), (0.03, 0.031), (0.03, 0.05)] {
        let audits =
            [1_000_000, 4_000_000, 16_000_000].map(|rays| furnace.audit(|t| 1.0 + error * noise(t), target, rays));
        for pair in audits.windows(2) {
            let (less, more) = (&pair[0], &pair[1]);
            assert!(
                less.error.low <= more.error.low && more.error.high <= less.error.high,
                "{target}: {:?} {:?}",
                less.error,
                more.error
            );
            assert!(more.verdict == less.verdict || less.verdict == Verdict::Uncertain, "{target}");
        }
        let width = |a: &Audit| a.error.high - a.error.low;
        if audits[2].rounds > audits[0].rounds {
            assert!(width(&audits[2]) < 0.8 * width(&audits[0]), "{target}: {:?}", audits.map(|a| a.error));
            narrower += 1;
        }
    }
    assert!(narrower >= 2, "budgets were used");
}

#[test]
fn threads_do_not_change_a_bit_of_the_audit() {
    let furnace = Furnace::new();
    let run = |threads| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("threads can be started");
        let audit = pool.install(|| furnace.audit(|t| 1.0 + 0.03 * noise(t), 0.02, 1_000_000));
        let estimates: Vec<_> = audit.texels.iter().map(|t| (t.texel, t.estimates)).collect();
        (estimates, audit.error, audit.rays)
    };
    assert_eq!(run(1), run(2));
}

#[test]
fn texels_that_are_filled_in_are_left_out() {
    let furnace = Furnace::new();
    let count = furnace.texels.len();
    let usable: Vec<bool> = (0..count).map(|t| t % 3 != 0).collect();
    let baked: Vec<Rgb> = usable.iter().map(|&u| if u { Rgb::splat(2.0 * PI) } else { Rgb::splat(1e4) }).collect();
    let settings = AuditSettings { target: 0.02, most_rays: 1_000_000, seed: 1 };
    let accel = Accel::build(&furnace.scene);
    let run = |usable: &[bool]| {
        audit(&accel, &furnace.atlas, &furnace.texels, usable, &baked, &settings, &Silent).expect("nobody cancels")
    };
    let found = run(&usable).expect("there are texels");
    assert_eq!(found.population, usable.iter().filter(|&&u| u).count());
    assert!(found.texels.iter().all(|t| t.texel % 3 != 0) && found.error.high < 0.05, "{:?}", found.error);
    assert!(run(&vec![false; count]).is_none());
}

#[test]
fn a_dark_scene_has_finite_figures() {
    let scene = cube([Face { radiance: 0.0, reflectance: 0.5 }; 6]);
    let (atlas, texels) = laid_out(&scene, 16.0);
    let accel = Accel::build(&scene);
    let run = |baked: f32| {
        let (baked, usable) = (vec![Rgb::splat(baked); texels.len()], vec![true; texels.len()]);
        let settings = AuditSettings { target: 0.02, most_rays: 1_000_000, seed: 1 };
        audit(&accel, &atlas, &texels, &usable, &baked, &settings, &Silent).expect("nobody cancels").expect("texels")
    };
    let black = run(0.0);
    assert_eq!((black.verdict, black.error.value, black.error.high), (Verdict::Met, 0.0, 0.0));
    let wrong = run(1.0);
    assert!(wrong.verdict == Verdict::Missed && wrong.error.value.is_finite());
}

#[test]
fn efforts_have_budgets() {
    assert_eq!(Effort::Off.most_rays(1 << 40), None);
    let (auto, thorough) = (Effort::Auto.most_rays(1 << 30), Effort::Thorough.most_rays(1 << 30));
    assert!(auto < thorough && auto.is_some_and(|rays| rays < 1 << 29));
    assert!(Effort::Auto.most_rays(0).is_some_and(|rays| rays > 0));
}

/// Cancels after so many questions.
struct Impatient(AtomicU32);

impl Progress for Impatient {
    fn report(&self, _: Stage, done: f64) {
        assert!((0.0..=1.0).contains(&done));
    }

    fn is_cancelled(&self) -> bool {
        self.0.fetch_sub(1, Ordering::Relaxed) <= 1
    }
}

#[test]
fn it_can_be_cancelled() {
    let Furnace { scene, atlas, texels } = Furnace::new();
    let (baked, usable) = (vec![Rgb::ONE; texels.len()], vec![true; texels.len()]);
    let settings = AuditSettings { target: 0.02, most_rays: 1_000_000, seed: 1 };
    let impatient = Impatient(AtomicU32::new(100));
    let ended = audit(&Accel::build(&scene), &atlas, &texels, &usable, &baked, &settings, &impatient);
    assert_eq!(ended.err(), Some(Cancelled));
}

//! The atlas and its texels: invariants that hold for any scene, and what is said about bad input.

mod checks;
mod keep;
mod placed;
mod scenes;
mod texels;

use checks::{auto, bake, codes, keep};
use glam::{Affine3A, Vec2, Vec3};
use lightkiln::atlas::{AtlasError, AtlasSettings, Unwrapper, UvMode, build, rasterise};
use lightkiln::progress::{Cancelled, Progress, Silent, Stage};
use lightkiln::scene::{LightmapRequest, Scene};
use scenes::{mesh, quad, scene, zoo};
use std::sync::mpsc;
use std::thread;
use std::time::Duration;

#[test]
fn repeats_are_identical_on_any_number_of_threads() {
    let place = (0..5).map(|i| Affine3A::from_translation(Vec3::X * i as f32)).collect();
    let s = scene(vec![(quad(Vec2::splat(0.13), Vec2::splat(0.77)), place)]);
    let run = |threads| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("threads can be started");
        pool.install(|| bake(&s, &keep(50)))
    };
    assert_eq!(run(1), run(3));
}

#[test]
fn repeats_of_every_mode_are_identical() {
    let settings = [
        auto(Unwrapper::Xatlas),
        auto(Unwrapper::Fast),
        AtlasSettings { resolution: Some(256), ..auto(Unwrapper::Xatlas) },
        AtlasSettings { uv: UvMode::Pack, ..AtlasSettings::default() },
    ];
    for settings in settings {
        assert_eq!(bake(&zoo(), &settings), bake(&zoo(), &settings));
    }
}

#[test]
fn what_wants_no_lightmap_gets_none() {
    let mut s = scene(vec![(quad(Vec2::ZERO, Vec2::ONE), vec![Affine3A::IDENTITY; 2])]);
    s.instances[0].lightmap = LightmapRequest::None;
    let (atlas, warnings, texels) = bake(&s, &keep(8));
    assert_eq!((codes(&warnings), texels.len()), (vec![], 64));
    assert!(atlas.layouts[0].is_none() && atlas.locate(0, 0, Vec2::ZERO).is_none());
}

#[test]
fn nothing_to_light_is_no_error() {
    let empty = mesh(&[], |_, _| Vec2::ZERO);
    for s in [Scene::default(), scene(vec![(empty, vec![Affine3A::IDENTITY])])] {
        assert!(bake(&s, &keep(8)).2.is_empty());
    }
}

#[test]
fn settings_out_of_range_are_refused() {
    let bad = [
        AtlasSettings { resolution: Some(0), ..AtlasSettings::default() },
        AtlasSettings { resolution: Some(1 << 20), ..AtlasSettings::default() },
        AtlasSettings { texels_per_metre: Some(0.0), ..AtlasSettings::default() },
        AtlasSettings { texels_per_metre: Some(f32::NAN), ..AtlasSettings::default() },
        AtlasSettings { max_page: 0, ..AtlasSettings::default() },
        AtlasSettings { padding: 4000, ..AtlasSettings::default() },
    ];
    for settings in bad {
        assert!(matches!(build(&Scene::default(), &settings, &Silent), Err(AtlasError::InvalidSetting { .. })));
    }
}

#[test]
fn cancelling_ends_it() {
    struct Impatient;
    impl Progress for Impatient {
        fn report(&self, _: Stage, _: f64) {}
        fn is_cancelled(&self) -> bool {
            true
        }
    }
    let s = scene(vec![(quad(Vec2::ZERO, Vec2::ONE), vec![Affine3A::IDENTITY])]);
    for settings in
        [keep(8), auto(Unwrapper::Xatlas), auto(Unwrapper::Fast), AtlasSettings { uv: UvMode::Pack, ..keep(8) }]
    {
        assert!(matches!(build(&s, &settings, &Impatient), Err(AtlasError::Cancelled(_))));
    }
    let (atlas, _) = build(&s, &keep(8), &Silent).expect("the scene can be laid out");
    assert_eq!(rasterise(&s, &atlas, &Impatient), Err(Cancelled));
}

/// xatlas sometimes waits for ever when it ends its threads, the likelier the less there was to do; see its module.
#[test]
fn thousands_of_small_atlases_come_to_an_end() {
    let (sender, receiver) = mpsc::channel();
    for _ in 0..4 {
        let sender = sender.clone();
        thread::spawn(move || {
            let s = scene(vec![(quad(Vec2::ZERO, Vec2::ONE), vec![Affine3A::IDENTITY])]);
            for _ in 0..5000 {
                bake(&s, &AtlasSettings { resolution: Some(8), ..auto(Unwrapper::Xatlas) });
                sender.send(()).expect("the test waits for all");
            }
        });
    }
    for made in 0..20_000 {
        assert!(receiver.recv_timeout(Duration::from_secs(60)).is_ok(), "nothing comes after {made} atlases");
    }
}

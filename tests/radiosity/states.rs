//! Previews, drafts and refinements, held against the finished lightmap of a room.

use super::rooms::{Room, laid_out, lit};
use super::{cube, grey};
use glam::Vec3;
use lightkiln::accel::Accel;
use lightkiln::atlas::{Atlas, Texels};
use lightkiln::bake::{self, Counts, Draft, FoundSoFar, Observer, Refinement};
use lightkiln::gather::{Lightmap, Probe};
use lightkiln::output::Milestone;
use lightkiln::output::report::StageClock;
use lightkiln::progress::{Cancelled, Silent};
use lightkiln::scene::{Light, LightGroups, LightShape, Rgb, Scene};

/// A room with a bulb, and a board that throws a shadow.
fn lit_room() -> Scene {
    let mut room = Room::default();
    room.inside_of_box(Vec3::ZERO, Vec3::ONE, [grey(0.0, 0.6); 6]);
    let low = Vec3::new(0.3, 0.4, 0.3);
    room.quad(low, Vec3::Z * 0.4, Vec3::X * 0.4, grey(0.0, 0.6));
    room.quad(low, Vec3::X * 0.4, Vec3::Z * 0.4, grey(0.0, 0.6));
    let mut scene = room.scene();
    scene.lights.push(Light {
        name: "Bulb".into(),
        path: "Bulb".into(),
        group: None,
        casts_shadows: true,
        position: Vec3::new(0.55, 0.8, 0.4),
        axes: [Vec3::X, Vec3::NEG_Z, Vec3::Y],
        shape: LightShape::Point { intensity: Rgb::ONE, radius: 0.06 },
        profile: None,
        faces_receivers: false,
    });
    scene
}

struct Stage {
    scene: Scene,
    atlas: Atlas,
    texels: Texels,
}

impl Stage {
    fn new(scene: Scene) -> Self {
        let (atlas, texels) = laid_out(&scene, 32.0);
        Self { scene, atlas, texels }
    }

    fn bake(&self, error: f32, observer: &mut dyn Observer) -> (Lightmap, f64) {
        let groups = LightGroups::none(&self.scene);
        let lit = lit(&Accel::build(&self.scene), (&self.atlas, &self.texels), &groups, error, observer);
        assert_eq!(lit.state.reached, Milestone::Final);
        (lit.lightmap, lit.state.predicted_error)
    }
}

/// Relative RMSE over the usable texels that are chosen.
fn off(light: &Lightmap, truth: &Lightmap, choose: impl Fn(usize) -> bool) -> f64 {
    let (mut squares, mut sum, mut count) = (0.0, 0.0, 0.0);
    for t in (0..truth.combined.len()).filter(|&t| truth.usable[t] && choose(t)) {
        squares += f64::from((light.combined[t] - truth.combined[t]).length_squared()) / 3.0;
        sum += f64::from(truth.combined[t].element_sum()) / 3.0;
        count += 1.0;
    }
    (squares / count).sqrt() / (sum / count)
}

/// Keeps what drafts say.
#[derive(Default)]
struct Witness {
    drafts: Vec<Draft>,
    texels: Vec<usize>,
}

impl Observer for Witness {
    fn wants_drafts(&self) -> bool {
        true
    }

    fn found(&mut self, so_far: &FoundSoFar, _: &Counts, draft: &mut dyn FnMut() -> Option<Draft>) {
        self.drafts.extend(draft());
        self.texels.push(so_far.probes.len());
    }
}

#[test]
fn previews_and_drafts_come_closer_to_the_result() {
    let stage = Stage::new(lit_room());
    let mut witness = Witness::default();
    let (light, predicted) = stage.bake(0.02, &mut witness);
    let (accel, clock) = (Accel::build(&stage.scene), StageClock::start());
    let groups = LightGroups::none(&stage.scene);
    let preview = bake::preview(&accel, &stage.atlas, &stage.texels, &groups, &clock, &Silent).expect("nobody cancels");
    let first = off(&preview.lightmap, &light, |_| true);
    assert!(first < 0.15, "the preview is {first} off");
    let expected = preview.state.predicted_error;
    assert!(expected > 0.4 * first && expected < 4.0 * first, "{expected} was expected, {first} found");

    let errors: Vec<f64> = witness.drafts.iter().map(|d| off(&d.lightmap, &light, |_| true)).collect();
    let (solution, last) = (errors[0], errors[errors.len() - 1]);
    assert_eq!(witness.drafts[0].state.reached, Milestone::Solution);
    assert!(errors.len() >= 3 && solution < first && last < 0.5 * solution, "{first} {errors:?}");
    assert!(witness.texels.is_sorted());
    assert!(predicted < 0.02 && predicted < expected, "{predicted}");
    assert!(witness.drafts.iter().all(|d| d.lightmap.combined.iter().all(|e| e.is_finite())));
}

#[test]
fn the_error_falls_with_the_target() {
    let stage = Stage::new(lit_room());
    let (truth, _) = stage.bake(0.003, &mut ());
    let errors = [0.16, 0.04, 0.01].map(|error| off(&stage.bake(error, &mut ()).0, &truth, |_| true));
    assert!(errors[1] < errors[0] && errors[2] < errors[1], "{errors:?}");
    assert!(errors[1] < 0.04 && errors[2] < 0.01, "{errors:?}");
}

/// Has one run of texels gathered again.
struct Picky {
    tile: std::ops::Range<u32>,
    asked: u32,
    before: Option<Lightmap>,
}

impl Observer for Picky {
    fn judge(
        &mut self,
        lightmap: &Lightmap,
        probes: &[(u32, Probe)],
        counts: &Counts,
    ) -> Result<Option<Refinement>, Cancelled> {
        assert!(!probes.is_empty());
        self.asked += 1;
        assert_eq!(counts.rays.contains_key("refine"), self.asked > 1);
        if self.asked > 1 {
            return Ok(None);
        }
        self.before = Some(lightmap.clone());
        Ok(Some(Refinement { tiles: vec![self.tile.clone()], error: 0.01 }))
    }
}

#[test]
fn what_is_gathered_again_is_better_and_the_rest_stays() {
    let stage = Stage::new(lit_room());
    let (truth, _) = stage.bake(0.003, &mut ());
    // The floor, with the board's shadow on it, and nothing else of the box.
    let floor = (0..stage.texels.len()).filter(|&t| stage.texels.position[t].y < 1e-4).map(|t| stage.texels.chart[t]);
    let chart = floor.max().expect("there is a floor");
    let tile = stage.texels.charts[chart as usize].clone();
    let mut picky = Picky { tile: tile.clone(), asked: 0, before: None };
    let (after, _) = stage.bake(0.1, &mut picky);
    let before = picky.before.expect("it was asked");
    let inside = |t: usize| tile.contains(&(t as u32));
    let (was, is) = (off(&before, &truth, inside), off(&after, &truth, inside));
    assert!(is < 0.6 * was, "{was} before, {is} after");
    assert!((0..stage.texels.len()).filter(|&t| !inside(t)).all(|t| before.combined[t] == after.combined[t]));
    assert_eq!(picky.asked, 2);
}

#[test]
fn dark_rooms_have_previews() {
    let stage = Stage::new(cube([grey(0.0, 0.5); 6]));
    let (accel, clock) = (Accel::build(&stage.scene), StageClock::start());
    let groups = LightGroups::none(&stage.scene);
    let preview = bake::preview(&accel, &stage.atlas, &stage.texels, &groups, &clock, &Silent).expect("nobody cancels");
    assert!(preview.lightmap.combined.iter().all(|e| *e == Rgb::ZERO) && preview.state.predicted_error == 0.0);
}

//! Embree 3 through its C interface: the yardstick, if the feature `embree` is on and `libembree-dev` is installed.

use lightkiln::accel::Ray;
use lightkiln::scene::Scene;
use std::ffi::{c_char, c_uint, c_void};
use std::ptr::null;

#[repr(C, align(16))]
struct RayHit {
    origin: [f32; 3],
    t_near: f32,
    direction: [f32; 3],
    time: f32,
    t_far: f32,
    mask: c_uint,
    id: c_uint,
    flags: c_uint,
    normal: [f32; 3],
    u: f32,
    v: f32,
    primitive: c_uint,
    geometry: c_uint,
    instance: c_uint,
}

#[repr(C)]
struct IntersectContext {
    flags: c_uint,
    filter: *const c_void,
    instance: c_uint,
}

#[link(name = "embree3")]
unsafe extern "C" {
    fn rtcNewDevice(config: *const c_char) -> *mut c_void;
    fn rtcReleaseDevice(device: *mut c_void);
    fn rtcNewScene(device: *mut c_void) -> *mut c_void;
    fn rtcReleaseScene(scene: *mut c_void);
    fn rtcNewGeometry(device: *mut c_void, kind: c_uint) -> *mut c_void;
    fn rtcSetNewGeometryBuffer(
        geometry: *mut c_void,
        kind: c_uint,
        slot: c_uint,
        format: c_uint,
        stride: usize,
        count: usize,
    ) -> *mut c_void;
    fn rtcCommitGeometry(geometry: *mut c_void);
    fn rtcAttachGeometry(scene: *mut c_void, geometry: *mut c_void) -> c_uint;
    fn rtcReleaseGeometry(geometry: *mut c_void);
    fn rtcCommitScene(scene: *mut c_void);
    fn rtcIntersect1(scene: *mut c_void, context: *mut IntersectContext, ray: *mut RayHit);
    fn rtcOccluded1(scene: *mut c_void, context: *mut IntersectContext, ray: *mut RayHit);
}

// Values of the enumerations in rtcore_geometry.h, rtcore_buffer.h and rtcore_common.h.
const GEOMETRY_TRIANGLE: c_uint = 0;
const BUFFER_INDEX: c_uint = 0;
const BUFFER_VERTEX: c_uint = 1;
const FORMAT_UINT3: c_uint = 0x5003;
const FORMAT_FLOAT3: c_uint = 0x9003;
const INVALID: c_uint = u32::MAX;

/// A committed Embree scene.
pub(crate) struct Embree {
    device: *mut c_void,
    scene: *mut c_void,
}

impl Embree {
    /// Builds over all instances, flattened.
    pub(crate) fn build(scene: &Scene) -> Self {
        let corners: Vec<[f32; 3]> = (0..scene.instances.len())
            .flat_map(|i| (0..scene.meshes[scene.instances[i].mesh].triangles.len()).map(move |t| (i, t)))
            .flat_map(|(i, t)| scene.corners(i, t).map(|p| p.to_array()))
            .collect();
        let indices: Vec<u32> = (0..corners.len() as u32).collect();
        // SAFETY: handles are used as the API prescribes, and both buffers are filled to the length they were asked for.
        unsafe {
            let device = rtcNewDevice(null());
            let embree = rtcNewScene(device);
            let geometry = rtcNewGeometry(device, GEOMETRY_TRIANGLE);
            let vertices = rtcSetNewGeometryBuffer(geometry, BUFFER_VERTEX, 0, FORMAT_FLOAT3, 12, corners.len());
            vertices.cast::<[f32; 3]>().copy_from_nonoverlapping(corners.as_ptr(), corners.len());
            let triangles = rtcSetNewGeometryBuffer(geometry, BUFFER_INDEX, 0, FORMAT_UINT3, 12, indices.len() / 3);
            triangles.cast::<u32>().copy_from_nonoverlapping(indices.as_ptr(), indices.len());
            rtcCommitGeometry(geometry);
            rtcAttachGeometry(embree, geometry);
            rtcReleaseGeometry(geometry);
            rtcCommitScene(embree);
            Self { device, scene: embree }
        }
    }

    /// Distance of the nearest hit.
    pub(crate) fn closest(&self, ray: &Ray) -> Option<f32> {
        let (mut ray, mut context) = (ray_hit(ray), context());
        // SAFETY: the scene is committed, the ray is aligned and complete.
        unsafe { rtcIntersect1(self.scene, &mut context, &mut ray) };
        (ray.geometry != INVALID).then_some(ray.t_far)
    }

    /// True if anything is hit.
    pub(crate) fn occluded(&self, ray: &Ray) -> bool {
        let (mut ray, mut context) = (ray_hit(ray), context());
        // SAFETY: as above; only the leading ray part is read and written.
        unsafe { rtcOccluded1(self.scene, &mut context, &mut ray) };
        ray.t_far == f32::NEG_INFINITY
    }
}

impl Drop for Embree {
    fn drop(&mut self) {
        // SAFETY: both handles came from the API and are released once.
        unsafe {
            rtcReleaseScene(self.scene);
            rtcReleaseDevice(self.device);
        }
    }
}

fn context() -> IntersectContext {
    IntersectContext { flags: 0, filter: null(), instance: INVALID }
}

fn ray_hit(ray: &Ray) -> RayHit {
    RayHit {
        origin: ray.origin.to_array(),
        t_near: ray.t_min,
        direction: ray.direction.to_array(),
        time: 0.0,
        t_far: ray.t_max,
        mask: INVALID,
        id: 0,
        flags: 0,
        normal: [0.0; 3],
        u: 0.0,
        v: 0.0,
        primitive: INVALID,
        geometry: INVALID,
        instance: INVALID,
    }
}

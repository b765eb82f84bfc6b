// The page that shows a lit GLB with three.js and measures the radiance that leaves it.
// In: a GLB (base64) and points with normals, metres. Out: linear RGB per point, W/(m²·sr).
import * as THREE from "three";
import { GLTFLoader } from "three/addons/loaders/GLTFLoader.js";

const LIFT = 1e-3; // the camera stands this far off the surface, metres
const FIELD = 1e-3; // and sees this much of it
const PIXELS = 4;

/** Reads MOZ_lightmap: the texel is irradiance divided by `intensity`, linear. */
class LightmapPlugin {
  constructor(parser) {
    this.name = "MOZ_lightmap";
    this.parser = parser;
  }

  async extendMaterialParams(index, params) {
    const lightmap = this.parser.json.materials[index].extensions?.MOZ_lightmap;
    if (!lightmap) return;
    await this.parser.assignTexture(params, "lightMap", { texCoord: 1, ...lightmap }, THREE.NoColorSpace);
    params.lightMapIntensity = lightmap.intensity ?? 1;
  }
}

/** The Lambertian part of a material: what a lightmap is defined for. */
function lambertian(material) {
  const { color, map, lightMap, lightMapIntensity, alphaTest, vertexColors } = material;
  return new THREE.MeshLambertMaterial({
    color, map, lightMap, lightMapIntensity, alphaTest, vertexColors, side: THREE.DoubleSide,
  });
}

function lookAt(point, normal) {
  const n = new THREE.Vector3(...normal).normalize();
  const camera = new THREE.OrthographicCamera(-FIELD / 2, FIELD / 2, FIELD / 2, -FIELD / 2, 0, 2 * LIFT);
  camera.up.set(...(Math.abs(n.y) > 0.9 ? [1, 0, 0] : [0, 1, 0]));
  camera.position.set(...point).addScaledVector(n, LIFT);
  camera.lookAt(camera.position.clone().sub(n));
  camera.updateMatrixWorld();
  return camera;
}

window.measure = async (base64, probes) => {
  const bytes = Uint8Array.from(atob(base64), (c) => c.charCodeAt(0));
  const loader = new GLTFLoader().register((parser) => new LightmapPlugin(parser));
  const { scene } = await loader.parseAsync(bytes.buffer, "");
  let lightmapped = 0;
  scene.traverse((object) => {
    if (!object.isMesh) return;
    lightmapped += object.material.lightMap ? 1 : 0;
    object.material = lambertian(object.material);
  });

  const renderer = new THREE.WebGLRenderer();
  const target = new THREE.WebGLRenderTarget(PIXELS, PIXELS, { type: THREE.FloatType });
  renderer.setRenderTarget(target);
  const pixels = new Float32Array(4 * PIXELS * PIXELS);
  const radiance = probes.map(({ point, normal }) => {
    renderer.render(scene, lookAt(point, normal));
    renderer.readRenderTargetPixels(target, 0, 0, PIXELS, PIXELS, pixels);
    return [0, 1, 2].map((channel) => {
      let sum = 0;
      for (let i = 0; i < PIXELS * PIXELS; i++) sum += pixels[4 * i + channel];
      return sum / (PIXELS * PIXELS);
    });
  });
  return { lightmapped, radiance };
};

// The page that shows a lit GLB with three.js: it measures the radiance that leaves it, and takes pictures.
// In: a GLB (base64); metres. Out: linear RGB per point, W/(m²·sr); a picture as a data URL.
import * as THREE from "three";
import { EXRLoader } from "three/addons/loaders/EXRLoader.js";
import { GLTFLoader } from "three/addons/loaders/GLTFLoader.js";

const LIFT = 1e-3; // the measuring camera stands this far off the surface, metres
const FIELD = 1e-3; // and sees this much of it
const PIXELS = 4;

/** Reads MOZ_lightmap: texel × `intensity` is irradiance, linear. EXR pages, if given, stand in for the 8-bit texture. */
class LightmapPlugin {
  constructor(parser, pages) {
    this.name = "MOZ_lightmap";
    this.parser = parser;
    this.pages = pages;
  }

  async extendMaterialParams(index, params) {
    const { materials, textures, images } = this.parser.json;
    const lightmap = materials[index].extensions?.MOZ_lightmap;
    if (!lightmap) return;
    const page = this.pages[images[textures[lightmap.index].source].extras?.lightmap?.uri];
    if (page) {
      params.lightMap = page;
      params.lightMapIntensity = 1;
    } else {
      await this.parser.assignTexture(params, "lightMap", { texCoord: 1, ...lightmap }, THREE.NoColorSpace);
      params.lightMapIntensity = lightmap.intensity ?? 1;
    }
  }
}

function bytesOf(base64) {
  return Uint8Array.from(atob(base64), (c) => c.charCodeAt(0)).buffer;
}

function exrTexture(base64) {
  const { data, width, height, format, type } = new EXRLoader().parse(bytesOf(base64));
  const texture = new THREE.DataTexture(data, width, height, format, type);
  // The loader stores the bottom row first; glTF's v = 0 is the top.
  texture.flipY = true;
  texture.channel = 1;
  texture.minFilter = texture.magFilter = THREE.LinearFilter;
  texture.needsUpdate = true;
  return texture;
}

/** The Lambertian part of a material: what a lightmap is defined for. */
function lambertian(material) {
  const { color, map, lightMap, lightMapIntensity, alphaTest, vertexColors, side } = material;
  const { emissive, emissiveMap, emissiveIntensity } = material;
  return new THREE.MeshLambertMaterial({
    color, map, lightMap, lightMapIntensity, alphaTest, vertexColors, side, emissive, emissiveMap, emissiveIntensity,
  });
}

async function load(base64, pages) {
  const loader = new GLTFLoader().register((parser) => new LightmapPlugin(parser, pages));
  const { scene, cameras } = await loader.parseAsync(bytesOf(base64), "");
  let lightmapped = 0;
  scene.traverse((object) => {
    // The lightmap holds the light of the file's lamps.
    object.visible &&= !object.isLight;
    if (!object.isMesh) return;
    lightmapped += object.material.lightMap ? 1 : 0;
    object.material = lambertian(object.material);
  });
  return { scene, cameras, lightmapped };
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
  const { scene, lightmapped } = await load(base64, {});
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

window.picture = async (base64, pages, exposure, width, height, type) => {
  const textures = Object.fromEntries(Object.entries(pages).map(([name, page]) => [name, exrTexture(page)]));
  const { scene, cameras } = await load(base64, textures);
  if (cameras.length === 0) throw new Error("the file has no camera");
  const world = new THREE.Scene().add(scene);
  world.background = new THREE.Color(0.8, 0.85, 0.9);
  world.updateMatrixWorld(true);
  const renderer = new THREE.WebGLRenderer({ antialias: true, preserveDrawingBuffer: true });
  renderer.setSize(width, height);
  renderer.toneMapping = THREE.AgXToneMapping;
  renderer.toneMappingExposure = exposure;
  const camera = cameras[0];
  camera.aspect = width / height;
  camera.updateProjectionMatrix();
  renderer.render(world, camera);
  return renderer.domElement.toDataURL(type, 0.9);
};

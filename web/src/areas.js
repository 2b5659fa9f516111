// The circles that hold the true places of real people with 95 %, painted on the ground: no part of a camera's pictures.

import { Color, CustomBlending, Group, Mesh, OneFactor, PlaneGeometry, ShaderMaterial, ZeroFactor } from "three";

const [KNOWN, ALARM] = [new Color(0, 0.66, 0.47), new Color(0.82, 0.13, 0.17)];
const RIM = 0.16; //: width of the line [m]

export class Areas {
  constructor(reference) {
    this.reference = reference;
    this.group = new Group();
    this.quad = new PlaneGeometry(1, 1);
    this.quad.rotateX(-Math.PI / 2);
  }

  /** Have the people {presence, x, y, radius} of a frame shown; of whom nobody knows the place, nothing. */
  show(people = []) {
    const known = people.filter(({ x, radius }) => x !== null && radius !== null);
    while (this.group.children.length < known.length) this.group.add(circle(this.quad));
    this.group.children.forEach((mesh, k) => {
      mesh.visible = k < known.length;
      if (!mesh.visible) return;
      const { presence, x, y, radius } = known[k];
      mesh.position.set(...this.reference.place(x, y));
      mesh.scale.set(2 * (radius + RIM), 1, 2 * (radius + RIM));
      const { uniforms } = mesh.material;
      uniforms.radius.value = radius;
      uniforms.colour.value = presence === "warning" || presence === "gone" ? ALARM : KNOWN;
    });
  }

  dispose() {
    this.quad.dispose();
    for (const mesh of this.group.children) mesh.material.dispose();
  }
}

function circle(quad) {
  const mesh = new Mesh(quad, new ShaderMaterial({
    blending: CustomBlending,
    blendSrcAlpha: ZeroFactor,
    blendDstAlpha: OneFactor,
    depthWrite: false,
    uniforms: { radius: { value: 1 }, colour: { value: KNOWN } },
    vertexShader: /* glsl */ `
      uniform float radius;
      varying vec2 at;
      void main() {
        at = position.xz * 2.0 * (radius + ${RIM.toFixed(2)});
        gl_Position = projectionMatrix * viewMatrix * modelMatrix * vec4(position, 1.0);
      }`,
    fragmentShader: /* glsl */ `
      uniform float radius;
      uniform vec3 colour;
      varying vec2 at;
      void main() {
        float far = length(at) - radius;
        if (far > ${RIM.toFixed(2)}) discard;
        gl_FragColor = vec4(colour, abs(far) < ${RIM.toFixed(2)} ? 0.9 : 0.18);
      }`,
  }));
  mesh.renderOrder = -1;
  mesh.frustumCulled = false;
  return mesh;
}

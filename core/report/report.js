// SPDX-License-Identifier: Apache-2.0
(() => {
  'use strict';
  const view = document.getElementById('view');
  if (!view) return;

  // Data: little-endian arrays as base64 in elements that no browser runs or shows.
  const bytes = (id) => {
    const element = document.getElementById(id);
    if (!element) return null;
    const text = atob(element.textContent);
    const result = new Uint8Array(text.length);
    for (let i = 0; i < text.length; ++i) result[i] = text.charCodeAt(i);
    return result;
  };
  const floats = (id) => {
    const data = bytes(id);
    return data && new Float32Array(data.buffer);
  };
  const points = floats('data-points');
  const before = floats('data-before');
  const corners = new Uint32Array(bytes('data-corners').buffer);
  const edges = bytes('data-edges');
  const count = edges.length;
  const fields = [...document.querySelectorAll('[data-field]')].map((element) => ({
    label: element.dataset.field,
    ofFaces: element.dataset.of === 'faces',
    better: element.dataset.better,
    low: Number(element.dataset.low),
    high: Number(element.dataset.high),
    clipped: element.dataset.clipped === 'true',
    values: floats(element.id),
  }));
  const centre = view.dataset.centre.split(',').map(Number);
  const scale = Number(view.dataset.scale);

  const canvas = document.getElementById('canvas');
  const mark = document.getElementById('mark');
  const fieldSelect = document.getElementById('field');
  const slider = document.getElementById('morph');
  const inside = document.getElementById('inside');
  const parts = new Uint16Array(bytes('data-part').buffer);
  const partBoxes = [...document.querySelectorAll('input[data-part]')];
  const hidden = (t) => partBoxes.length > 0 && !partBoxes[parts[t]].checked;
  const wires = document.getElementById('wires');

  // Colours: bad is warm where a field has a bad end, otherwise dark to bright.
  const good = [[38, 97, 135], [98, 160, 180], [214, 221, 214], [224, 150, 92], [176, 52, 28]];
  const plain = [[68, 1, 84], [59, 82, 139], [33, 145, 140], [94, 201, 98], [253, 231, 37]];
  const rampOf = (field) => field.better === 'neither' ? plain : field.better === 'lower' ? good : [...good].reverse();
  const grey = [150, 156, 162];
  const colour = (ramp, t) => {
    const place = Math.min(Math.max(t, 0), 1) * (ramp.length - 1);
    const k = Math.min(Math.floor(place), ramp.length - 2), f = place - k;
    return [0, 1, 2].map((c) => Math.round(ramp[k][c] * (1 - f) + ramp[k + 1][c] * f));
  };
  const shown = (v) => Number(v.toPrecision(4)).toString();
  const shownLow = (f) => shown(Math.abs(f.low) < 1e-4 * Math.abs(f.high) ? 0 : f.low);

  const colours = new Uint8Array(12 * count);  // per corner of a triangle; the fourth byte: which edges to draw, 8: hidden
  let field = null;
  const paint = () => {
    field = fields[Number(fieldSelect.value)] || null;
    const ramp = field ? rampOf(field) : null;
    const table = ramp && Array.from({length: 256}, (_, i) => colour(ramp, i / 255));
    const range = field ? field.high - field.low || 1 : 1;
    for (let i = 0; i < 3 * count; ++i) {
      let c = grey;
      if (field) {
        const v = field.values[field.ofFaces ? Math.floor(i / 3) : corners[i]];
        if (!Number.isNaN(v)) c = table[Math.min(255, Math.max(0, Math.round((v - field.low) / range * 255)))];
      }
      colours[4 * i] = c[0];
      colours[4 * i + 1] = c[1];
      colours[4 * i + 2] = c[2];
      const t = Math.floor(i / 3);
      colours[4 * i + 3] = edges[t] | (hidden(t) ? 8 : 0);
    }
    document.querySelector('.legend').hidden = !field;
    if (field) {
      document.getElementById('low').textContent = shownLow(field);
      document.getElementById('high').textContent = (field.clipped ? '\u2265 ' : '') + shown(field.high);
      const stops = ramp.map((c) => `rgb(${c.join(',')})`).join(',');
      document.getElementById('ramp').style.background = `linear-gradient(90deg,${stops})`;
    }
  };

  const corner = (i) => 3 * corners[i];

  // Camera: orthographic, z upwards; the mesh fits a sphere of radius 1 around the origin.
  let camera = {yaw: -0.9, pitch: 0.45, zoom: 1, target: [0, 0, 0]};
  let marked = null;
  const axes = () => {
    const cy = Math.cos(camera.yaw), sy = Math.sin(camera.yaw), cp = Math.cos(camera.pitch), sp = Math.sin(camera.pitch);
    return {right: [-sy, cy, 0], up: [-cy * sp, -sy * sp, cp], back: [cy * cp, sy * cp, sp]};
  };
  const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
  const size = () => ({width: canvas.clientWidth, height: canvas.clientHeight});
  const pixels = () => {  // per unit
    const {width, height} = size();
    return camera.zoom * Math.min(width, height) / 2;
  };
  // All of the mesh in the middle, as large as it goes.
  const fit = () => {
    const {right, up} = axes(), {width, height} = size();
    const low = [Infinity, Infinity], high = [-Infinity, -Infinity];
    const all = !partBoxes.some((box) => box.checked);
    for (let k = 0; k < corners.length; ++k) {
      if (!all && hidden(Math.floor(k / 3))) continue;
      const i = corner(k), at = [points[i], points[i + 1], points[i + 2]];
      [right, up].forEach((axis, n) => {
        const x = dot(at, axis);
        low[n] = Math.min(low[n], x);
        high[n] = Math.max(high[n], x);
      });
    }
    const across = Math.max((high[0] - low[0]) / width, (high[1] - low[1]) / height) || 1;
    camera.zoom = 0.92 * 2 / (across * Math.min(width, height));
    const middle = [0, 1].map((n) => (low[n] + high[n]) / 2);
    camera.target = [0, 1, 2].map((c) => middle[0] * right[c] + middle[1] * up[c]);
    return camera.zoom;
  };
  const morph = () => slider ? Number(slider.value) / 100 : 1;

  const placed = (array) => {
    const result = new Float32Array(9 * count);
    for (let i = 0; i < 3 * count; ++i) result.set(array.subarray(corner(i), corner(i) + 3), 3 * i);
    return result;
  };

  const vertexSource = `#version 300 es
  in vec3 after, before;
  in vec4 colour;
  uniform mat3 turn;
  uniform vec3 target;
  uniform vec2 stretch;
  uniform float morph, zoom;
  out vec3 place, shade, weights;
  flat out int mask;
  void main() {
    place = turn * (mix(before, after, morph) - target);
    shade = colour.rgb;
    mask = int(colour.a * 255.0 + 0.5);
    int k = gl_VertexID % 3;
    weights = vec3(k == 0, k == 1, k == 2);
    gl_Position = (mask & 8) != 0 ? vec4(2.0, 2.0, 2.0, 1.0) : vec4(place.xy * stretch, -place.z * 0.25, 1.0);
  }`;
  const fragmentSource = `#version 300 es
  precision highp float;
  in vec3 place, shade, weights;
  flat in int mask;
  uniform float wires;
  out vec4 result;
  void main() {
    vec3 normal = cross(dFdx(place), dFdy(place));
    float size = length(normal);
    float light = size > 0.0 ? abs(dot(normal / size, normalize(vec3(0.25, 0.35, 0.9)))) : 1.0;
    vec3 c = shade * (0.5 + 0.5 * light);
    vec3 away = weights / max(fwidth(weights), vec3(1e-6));
    float near = 10.0;
    if ((mask & 1) != 0) near = min(near, away.x);
    if ((mask & 2) != 0) near = min(near, away.y);
    if ((mask & 4) != 0) near = min(near, away.z);
    vec3 extent = 1.0 / max(fwidth(weights), vec3(1e-6));  // of the triangle in pixels; dense edges would hide the colours
    float room = smoothstep(5.0, 16.0, min(extent.x, min(extent.y, extent.z)));
    float line = (1.0 - smoothstep(0.5, 1.4, near)) * 0.55 * room * wires;
    result = vec4(mix(c, vec3(0.07, 0.09, 0.11), line), 1.0);
  }`;

  const makeGl = () => {
    const gl = canvas.getContext('webgl2', {antialias: true});
    if (!gl) return null;
    const program = gl.createProgram();
    for (const [type, source] of [[gl.VERTEX_SHADER, vertexSource], [gl.FRAGMENT_SHADER, fragmentSource]]) {
      const shader = gl.createShader(type);
      gl.shaderSource(shader, source);
      gl.compileShader(shader);
      gl.attachShader(program, shader);
    }
    gl.linkProgram(program);
    if (!gl.getProgramParameter(program, gl.LINK_STATUS)) throw new Error(gl.getProgramInfoLog(program));
    gl.useProgram(program);
    const buffer = (name, length, type, normalized, data) => {
      const place = gl.getAttribLocation(program, name), b = gl.createBuffer();
      gl.bindBuffer(gl.ARRAY_BUFFER, b);
      gl.bufferData(gl.ARRAY_BUFFER, data, gl.DYNAMIC_DRAW);
      gl.enableVertexAttribArray(place);
      gl.vertexAttribPointer(place, length, type, normalized, 0, 0);
      return b;
    };
    const after = placed(points);
    buffer('after', 3, gl.FLOAT, false, after);
    buffer('before', 3, gl.FLOAT, false, before ? placed(before) : after);
    const colourBuffer = buffer('colour', 4, gl.UNSIGNED_BYTE, true, colours);
    const at = (name) => gl.getUniformLocation(program, name);
    gl.enable(gl.DEPTH_TEST);
    return {
      recolour() {
        gl.bindBuffer(gl.ARRAY_BUFFER, colourBuffer);
        gl.bufferSubData(gl.ARRAY_BUFFER, 0, colours);
      },
      draw() {
        const {right, up, back} = axes(), {width, height} = size();
        gl.viewport(0, 0, canvas.width, canvas.height);
        gl.clearColor(0, 0, 0, 0);
        gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);
        gl.uniformMatrix3fv(at('turn'), false, [0, 1, 2].flatMap((k) => [right[k], up[k], back[k]]));
        gl.uniform3fv(at('target'), camera.target);
        gl.uniform2f(at('stretch'), 2 * pixels() / width, 2 * pixels() / height);
        gl.uniform1f(at('morph'), morph());
        gl.uniform1f(at('wires'), wires.checked ? 1 : 0);
        // Faces look outward: without those that look at us one sees what is behind them.
        if (inside.checked) gl.enable(gl.CULL_FACE);
        else gl.disable(gl.CULL_FACE);
        gl.cullFace(gl.FRONT);
        gl.drawArrays(gl.TRIANGLES, 0, 3 * count);
      },
    };
  };

  // Without WebGL: triangles from back to front, at most so many.
  const make2d = () => {
    const context = canvas.getContext('2d'), most = 40000, step = Math.ceil(count / most);
    const drawn = Array.from({length: Math.ceil(count / step)}, (_, i) => i * step);
    if (step > 1) document.getElementById('without').textContent = ` Without WebGL every ${step}th triangle is shown.`;
    const depth = new Float32Array(count), flat = new Float32Array(6 * count), light = new Float32Array(count);
    return {
      recolour() {},
      draw() {
        const {right, up, back} = axes(), m = morph(), p = pixels() * canvas.width / size().width;
        for (const t of drawn) {
          const place = [0, 1, 2].map((k) => {
            const i = corner(3 * t + k);
            const at = [0, 1, 2].map((c) => (before ? before[i + c] * (1 - m) + points[i + c] * m : points[i + c]) - camera.target[c]);
            return [dot(at, right), dot(at, up), dot(at, back)];
          });
          for (let k = 0; k < 3; ++k) {
            flat[6 * t + 2 * k] = canvas.width / 2 + place[k][0] * p;
            flat[6 * t + 2 * k + 1] = canvas.height / 2 - place[k][1] * p;
          }
          depth[t] = place[0][2] + place[1][2] + place[2][2];
          const u = [0, 1, 2].map((c) => place[1][c] - place[0][c]), v = [0, 1, 2].map((c) => place[2][c] - place[0][c]);
          const n = [u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2], u[0] * v[1] - u[1] * v[0]];
          light[t] = n[2] / (Math.hypot(...n) || 1);
        }
        drawn.sort((a, b) => depth[a] - depth[b]);
        context.clearRect(0, 0, canvas.width, canvas.height);
        for (const t of drawn) {
          if (hidden(t) || (inside.checked && light[t] > 0)) continue;
          const c = [0, 1, 2].map((k) => Math.round((colours[12 * t + k] + colours[12 * t + 4 + k] + colours[12 * t + 8 + k]) / 3 * (0.5 + 0.5 * Math.abs(light[t]))));
          context.beginPath();
          for (let k = 0; k < 3; ++k) context.lineTo(flat[6 * t + 2 * k], flat[6 * t + 2 * k + 1]);
          context.closePath();
          context.fillStyle = `rgb(${c.join(',')})`;
          context.fill();
          context.strokeStyle = wires.checked ? 'rgba(18,23,28,.5)' : context.fillStyle;
          context.stroke();
        }
      },
    };
  };

  for (const [i, f] of fields.entries()) fieldSelect.add(new Option(f.label, i));
  fieldSelect.add(new Option('none', -1));
  paint();
  const painter = makeGl() || make2d();

  let asked = false;
  const redraw = () => {
    if (asked) return;
    asked = true;
    requestAnimationFrame(() => {
      asked = false;
      painter.draw();
      mark.hidden = !marked;
      if (!marked) return;
      const {right, up} = axes(), {width, height} = size();
      const at = marked.map((x, k) => x - camera.target[k]);
      mark.style.left = `${width / 2 + dot(at, right) * pixels()}px`;
      mark.style.top = `${height / 2 - dot(at, up) * pixels()}px`;
    });
  };
  let fitted = 0;  // zoom at which all is seen
  const resize = () => {
    if (!fitted) fitted = fit();
    const ratio = window.devicePixelRatio || 1, {width, height} = size();
    canvas.width = Math.max(1, Math.round(width * ratio));
    canvas.height = Math.max(1, Math.round(height * ratio));
    redraw();
  };
  new ResizeObserver(resize).observe(canvas);

  const turn = (dx, dy) => {
    camera.yaw -= dx;
    camera.pitch = Math.min(1.57, Math.max(-1.57, camera.pitch + dy));
    redraw();
  };
  const move = (dx, dy) => {
    const {right, up} = axes();
    camera.target = camera.target.map((x, k) => x - (dx * right[k] - dy * up[k]) / pixels());
    redraw();
  };
  const zoom = (factor) => {
    camera.zoom = Math.min(1e5, Math.max(0.05, camera.zoom * factor));
    redraw();
  };

  const fingers = new Map();
  canvas.addEventListener('pointerdown', (event) => {
    canvas.setPointerCapture(event.pointerId);
    fingers.set(event.pointerId, [event.clientX, event.clientY]);
  });
  canvas.addEventListener('pointermove', (event) => {
    const last = fingers.get(event.pointerId);
    if (!last) return;
    const now = [event.clientX, event.clientY], dx = now[0] - last[0], dy = now[1] - last[1];
    if (fingers.size === 1) {
      if (event.buttons & 6 || event.shiftKey) move(dx, dy);
      else turn(dx * 0.008, dy * 0.008);
    } else if (fingers.size === 2) {
      const other = [...fingers.entries()].find(([id]) => id !== event.pointerId)[1];
      const gap = (p) => Math.hypot(p[0] - other[0], p[1] - other[1]);
      zoom(gap(now) / (gap(last) || 1));
      move(dx / 2, dy / 2);
    }
    fingers.set(event.pointerId, now);
  });
  for (const name of ['pointerup', 'pointercancel']) canvas.addEventListener(name, (event) => fingers.delete(event.pointerId));
  canvas.addEventListener('wheel', (event) => {
    event.preventDefault();
    zoom(Math.exp(-event.deltaY * (event.deltaMode ? 0.05 : 0.0015)));
  }, {passive: false});
  canvas.addEventListener('contextmenu', (event) => event.preventDefault());
  const reset = () => {
    camera.yaw = -0.9;
    camera.pitch = 0.45;
    fitted = fit();
    marked = null;
    redraw();
  };
  canvas.addEventListener('dblclick', reset);
  canvas.addEventListener('keydown', (event) => {
    const act = {
      ArrowLeft: () => turn(-0.1, 0), ArrowRight: () => turn(0.1, 0), ArrowUp: () => turn(0, -0.1), ArrowDown: () => turn(0, 0.1),
      '+': () => zoom(1.2), '-': () => zoom(1 / 1.2), 0: reset,
    }[event.key];
    if (!act) return;
    event.preventDefault();
    act();
  });
  const sides = {x: [0, 0], y: [-Math.PI / 2, 0], z: [-Math.PI / 2, 1.57]};
  for (const button of document.querySelectorAll('[data-side]')) {
    button.addEventListener('click', () => {
      [camera.yaw, camera.pitch] = sides[button.dataset.side];
      fitted = fit();
      redraw();
    });
  }
  document.getElementById('reset').addEventListener('click', reset);
  fieldSelect.addEventListener('change', () => {
    paint();
    painter.recolour();
    redraw();
  });
  if (slider) slider.addEventListener('input', redraw);
  for (const box of [wires, inside]) box.addEventListener('change', redraw);
  const showParts = () => {
    paint();
    painter.recolour();
    fitted = fit();
    redraw();
  };
  for (const box of partBoxes) box.addEventListener('change', showParts);
  for (const [id, checked] of [['all-parts', true], ['no-parts', false]]) {
    const button = document.getElementById(id);
    if (!button) continue;
    button.addEventListener('click', () => {
      for (const box of partBoxes) box.checked = checked;
      showParts();
    });
  }
  for (const button of document.querySelectorAll('[data-at]')) {
    button.hidden = false;
    button.addEventListener('click', () => {
      marked = button.dataset.at.split(',').map((x, k) => (Number(x) - centre[k]) / scale);
      camera.target = [...marked];
      // From the side of the mesh where it is: mostly the outside.
      camera.yaw = Math.atan2(marked[1], marked[0]);
      camera.pitch = 0.8 * Math.atan2(marked[2], Math.hypot(marked[0], marked[1]));
      camera.zoom = Math.max(camera.zoom, 5 * fitted);
      if (slider) slider.value = 100;
      redraw();
      view.scrollIntoView({block: 'center', behavior: 'smooth'});
    });
  }
})();

"use strict";
// Mode shapes that move: `viewer` holds a canvas, a select, a button and a range; `content` holds the numbers of ema.show.moving.
function moveShapes(viewer, content) {
  const canvas = viewer.querySelector("canvas"), pen = canvas.getContext("2d");
  const choice = viewer.querySelector("select"), button = viewer.querySelector("button"), size = viewer.querySelector("input");
  let count, shapes, known;
  let across = -0.9, up = 0.45, zoom = 1, phase = 0, last = 0, visible = false;
  let moving = !matchMedia("(prefers-reduced-motion: reduce)").matches;
  const colours = [[0, 32, 76], [65, 77, 107], [124, 123, 120], [188, 175, 111], [255, 234, 70]];
  const colour = value => {
    const place = Math.min(3.999, 4 * Math.max(0, value)), low = Math.floor(place), part = place - low;
    return `rgb(${colours[low].map((c, k) => Math.round(c + part * (colours[low + 1][k] - c))).join(",")})`;
  };
  const update = next => {
    const chosen = choice.value;
    content = next; count = content.points.length; known = new Map();
    shapes = content.shapes.map(text => new Int16Array(Uint8Array.from(atob(text), letter => letter.charCodeAt(0)).buffer));
    choice.replaceChildren(...content.modes.map((name, place) => new Option(name, place)));
    if (chosen && chosen < shapes.length) choice.value = chosen;
    draw();
  };
  const amounts = shape => {
    if (!known.has(shape))
      known.set(shape, content.points.map((_, n) => Math.hypot(
        shape[3 * n], shape[3 * n + 1], shape[3 * n + 2], shape[3 * (count + n)], shape[3 * (count + n) + 1], shape[3 * (count + n) + 2]
      ) / 32000));
    return known.get(shape);
  };
  const project = (x, y, z, scale) => {
    const a = Math.cos(across) * x - Math.sin(across) * y, b = Math.sin(across) * x + Math.cos(across) * y;
    return [canvas.width / 2 + scale * a, canvas.height / 2 - scale * (Math.sin(up) * b + Math.cos(up) * z),
            Math.cos(up) * b - Math.sin(up) * z];
  };
  const draw = () => {
    pen.clearRect(0, 0, canvas.width, canvas.height);
    if (!shapes || !shapes.length) return;
    const shape = shapes[choice.value] || shapes[0], scale = zoom * 0.72 * Math.min(canvas.width, 1.7 * canvas.height);
    const real = 0.13 * size.value / 100 * Math.cos(phase) / 32000, imaginary = -0.13 * size.value / 100 * Math.sin(phase) / 32000;
    const rest = [], moved = [], amount = amounts(shape);
    for (let n = 0; n < count; n++) {
      const p = content.points[n], d = [0, 1, 2].map(k => real * shape[3 * n + k] + imaginary * shape[3 * (count + n) + k]);
      rest.push(project(p[0], p[1], p[2], scale));
      moved.push(project(p[0] + d[0], p[1] + d[1], p[2] + d[2], scale));
    }
    const path = (points, chain, close) => {
      pen.beginPath();
      chain.forEach((n, place) => place ? pen.lineTo(points[n][0], points[n][1]) : pen.moveTo(points[n][0], points[n][1]));
      if (close) pen.closePath();
    };
    const mean = (chain, of) => chain.reduce((sum, n) => sum + of(n), 0) / chain.length;
    pen.lineWidth = 1; pen.strokeStyle = "#c4c4c4"; pen.lineJoin = "round";
    for (const face of content.faces) { path(rest, face, true); pen.stroke(); }
    for (const line of content.lines) { path(rest, line, false); pen.stroke(); }
    const sorted = content.faces.map(face => [mean(face, n => moved[n][2]), face]).sort((a, b) => b[0] - a[0]);
    pen.strokeStyle = "#333333"; pen.lineWidth = 0.7;
    for (const [, face] of sorted) { path(moved, face, true); pen.fillStyle = colour(mean(face, n => amount[n])); pen.fill(); pen.stroke(); }
    pen.lineWidth = content.faces.length ? 1.5 : 3;
    for (const line of content.lines) { pen.strokeStyle = colour(mean(line, n => amount[n])); path(moved, line, false); pen.stroke(); }
    if (!content.faces.length && !content.lines.length)
      moved.forEach((p, n) => { pen.fillStyle = colour(amount[n]); pen.fillRect(p[0] - 3, p[1] - 3, 6, 6); });
  };
  const fit = () => {
    const sharp = window.devicePixelRatio || 1;
    canvas.width = Math.round(canvas.clientWidth * sharp); canvas.height = Math.round(canvas.clientHeight * sharp);
    draw();
  };
  const step = now => {
    if (moving && visible) { phase = (phase + (now - last) * 2 * Math.PI / 1600) % (2 * Math.PI); draw(); }
    last = now;
    requestAnimationFrame(step);
  };
  const toggle = () => { moving = !moving; label(); };
  const label = () => { button.textContent = moving ? "Stop" : "Move"; button.setAttribute("aria-pressed", String(moving)); };
  button.addEventListener("click", toggle);
  choice.addEventListener("change", draw);
  size.addEventListener("input", draw);
  canvas.addEventListener("pointerdown", event => canvas.setPointerCapture(event.pointerId));
  canvas.addEventListener("pointermove", event => {
    if (!event.buttons) return;
    across -= event.movementX / 150; up = Math.max(-1.57, Math.min(1.57, up + event.movementY / 150)); draw();
  });
  canvas.addEventListener("wheel", event => {
    event.preventDefault(); zoom = Math.max(0.2, Math.min(8, zoom * Math.exp(-event.deltaY / 500))); draw();
  }, { passive: false });
  canvas.addEventListener("keydown", event => {
    const turns = { ArrowLeft: [0.1, 0], ArrowRight: [-0.1, 0], ArrowUp: [0, 0.1], ArrowDown: [0, -0.1] }[event.key];
    if (event.key === " ") toggle();
    else if (event.key === "+" || event.key === "-") zoom *= event.key === "+" ? 1.1 : 1 / 1.1;
    else if (turns) { across += turns[0]; up = Math.max(-1.57, Math.min(1.57, up + turns[1])); }
    else return;
    event.preventDefault(); draw();
  });
  new IntersectionObserver(seen => { visible = seen[seen.length - 1].isIntersecting; }).observe(canvas);
  new ResizeObserver(fit).observe(canvas);
  update(content);
  label();
  requestAnimationFrame(step);
  return { update, frames: () => phase };
}

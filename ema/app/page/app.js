"use strict";
const letters = { o: [say("new"), faint, 7], f: [say("frequency"), grey, 9], d: [say("frequency and damping"), "#e69f00", 10],
                  v: [say("frequency and vector"), "#009e73", 10], s: [say("stable"), blue, 11] };
const page = { revision: -1, run: null, shapes: null, hits: null, polesOf: "" };

let queue = Promise.resolve();
function act(name, content = {}) {
  // one after the other: quick clicks must not overtake each other
  queue = queue.then(async () => {
    part("busy").textContent = say("working …");
    try {
      const reply = await (await ask(`api/${name}`, { method: "POST", headers: { "X-Ema": "1" }, body: JSON.stringify(content) })).json();
      fine();
      if (name === "save") part("busy").dataset.saved = reply.done;
      await show(reply);
    } catch (error) { fail(error.message); } finally { part("busy").textContent = ""; }
  });
  return queue;
}

async function drawPoles(overview) {
  const reply = await get("api/poles");
  const place = part("poles");
  if (reply.missing) { Plotly.purge(place); place.textContent = reply.missing; return; }
  page.poles = reply;
  const traces = reply.cmif.map(column => ({ x: reply.lines, y: column, yaxis: "y2", mode: "lines", line: { color: faint, width: 1 }, hoverinfo: "skip" }));
  for (const [letter, [meaning, colour, size]] of Object.entries(letters)) {
    const rows = reply.letter.flatMap((found, row) => found === letter ? [row] : []);
    traces.push({ x: rows.map(row => reply.frequency[row]), y: rows.map(row => reply.order[row]), customdata: rows, mode: "text", text: rows.map(() => letter),
      textfont: { color: colour, size }, name: meaning,
      hovertemplate: rows.map(row => `${reply.frequency[row].toFixed(2)} Hz, ${reply.damping[row]} %<br>${say("order {order}", { order: reply.order[row] })}, ${meaning}<extra></extra>`) });
  }
  traces.push({ x: reply.picked.map(row => reply.frequency[row]), y: reply.picked.map(row => reply.order[row]), customdata: reply.picked, mode: "markers",
    marker: { symbol: "circle-open", size: 15, color: vermilion, line: { width: 2 } }, name: say("picked"),
    hovertemplate: reply.picked.map(row => `${reply.frequency[row].toFixed(2)} Hz, ${say("picked")}<extra></extra>`) });
  const lines = overview.modes.map(mode => ({ type: "line", x0: mode.f, x1: mode.f, yref: "paper", y0: 0, y1: 1, line: { color: vermilion, width: 1, dash: "dash" }, layer: "below" }));
  const numbers = overview.modes.map((mode, place) => ({ x: mode.f, y: 1.0, yref: "paper", yanchor: "bottom", text: String(place + 1), showarrow: false, font: { color: vermilion, size: 10 } }));
  await Plotly.react(place, traces, base({ margin: { l: 52, r: 58, t: 20, b: 40 }, shapes: lines, annotations: numbers, uirevision: overview.run,
    xaxis: axis("Frequency [Hz]", { range: reply.band }), yaxis: axis("Model order", { rangemode: "tozero" }),
    yaxis2: axis("CMIF", { type: "log", overlaying: "y", side: "right", showgrid: false, color: grey, dtick: 1, exponentformat: "power" }) }), quiet);
  if (!place.dataset.wired) {
    place.dataset.wired = "1";
    place.on("plotly_click", event => { const point = event.points.find(one => one.customdata !== undefined); if (point) act("pick", { row: point.customdata }); });
  }
  place.dataset.picked = reply.picked.length;
}

async function drawFrf() {
  const output = part("output").selectedIndex, input = part("input").selectedIndex;
  const reply = await get(`api/frf?output=${Math.max(output, 0)}&input=${Math.max(input, 0)}`);
  for (const [id, names, place] of [["output", reply.outputs, output], ["input", reply.inputs, input]])
    if (part(id).options.length !== names.length || (part(id).options[0] || {}).text !== names[0]) {
      part(id).replaceChildren(...names.map(name => new Option(name)));
      part(id).selectedIndex = place >= 0 && place < names.length ? place : 0;
    }
  part("misfit").textContent = reply.error == null ? "" : say("error of the synthesised FRF {error} %", { error: reply.error });
  const traces = [{ x: reply.measured.f, y: reply.measured.magnitude, line: { color: "#1a1a1a", width: 1.2 }, name: say("measured") },
                  { x: reply.measured.f, y: reply.measured.phase, yaxis: "y2", line: { color: "#1a1a1a", width: 1 }, name: say("measured") }];
  if (reply.synthesised) traces.push({ x: reply.synthesised.f, y: reply.synthesised.magnitude, line: { color: vermilion, width: 1.4, dash: "dash" }, name: say("modal model") },
                                { x: reply.synthesised.f, y: reply.synthesised.phase, yaxis: "y2", line: { color: vermilion, width: 1, dash: "dash" }, name: say("modal model") });
  if (reply.coherence) traces.push({ x: reply.coherence_lines, y: reply.coherence, yaxis: "y3", line: { color: blue, width: 1 }, name: say("coherence") });
  traces.forEach(one => { one.mode = "lines"; });
  await Plotly.react("frf", traces, base({ uirevision: page.run, xaxis: axis("Frequency [Hz]", { anchor: "y3" }),
    yaxis: axis(reply.unit, { type: "log", domain: [0.45, 1], exponentformat: "power" }), yaxis2: axis("Phase [°]", { domain: [0.2, 0.42], tickvals: [-180, 0, 180] }),
    yaxis3: axis("Coh.", { domain: [0, 0.16], range: [0, 1.02] }) }), quiet);
}

async function drawMac() {
  const { mac } = await get("api/matrix");
  const names = mac.map((_, place) => String(place + 1));
  await Plotly.react("mac", [{ type: "heatmap", z: mac, x: names, y: names, zmin: 0, zmax: 1, colorscale: "Cividis", colorbar: { title: { text: "AutoMAC" }, thickness: 12 },
    hovertemplate: `${say("modes {first} and {second}", { first: "%{y}", second: "%{x}" })}: %{z:.3f}<extra></extra>` }],
    base({ xaxis: axis("Mode", { type: "category", constrain: "domain" }), yaxis: axis("Mode", { type: "category", scaleanchor: "x", autorange: "reversed", constrain: "domain" }) }), quiet);
  part("mac").dataset.modes = mac.length;
}

async function drawMotion() {
  const reply = await get("api/motion");
  part("still").textContent = reply.missing || (reply.modes.length ? "" : say("The shapes are too many points to move."));
  const content = reply.missing ? { points: [], faces: [], lines: [], modes: [], shapes: [] } : reply;
  if (page.shapes) page.shapes.update(content); else page.shapes = moveShapes(document.querySelector(".motion"), content);
}

function drawModes(overview) {
  const number = (value, digits) => value == null ? "–" : Number(value).toFixed(digits);
  part("modes").tBodies[0].replaceChildren(...overview.modes.map((mode, place) => {
    const row = document.createElement("tr");
    for (const text of [place + 1, number(mode.f, 3), mode.std_f == null ? "–" : (2 * mode.std_f).toPrecision(2), number(mode.zeta, 4),
                        mode.std_zeta == null ? "–" : (2 * mode.std_zeta).toPrecision(2), number(mode.mpc, 3)])
      row.insertCell().textContent = text;
    const button = document.createElement("button");
    button.textContent = say("Drop"); button.setAttribute("aria-label", say("Drop mode {mode}", { mode: place + 1 }));
    button.addEventListener("click", () => act("drop", { mode: place }));
    row.insertCell().append(button);
    return row;
  }));
  part("misfits").textContent = overview.error == null ? say("{number} modes", { number: overview.modes.length })
    : say("{number} modes, error of the synthesised FRFs {error} % (median); ± is two standard deviations within this run", { number: overview.modes.length, error: overview.error });
  part("findings").replaceChildren(...overview.findings.slice(0, 20).map(found => Object.assign(document.createElement("li"), { textContent: `${found.severity}: ${found.text}` })));
}

const impact = hit => `${hit.record}, ${say("impact {number}", { number: hit.index + 1 })}, ${hit.dof}`;

async function drawHits() {
  const reply = await get("api/hits");
  page.hits = reply.hits || [];
  part("gallery").hidden = Boolean(reply.missing);
  if (reply.missing) return;
  const taken = page.hits.filter(hit => hit.accepted).length;
  part("counts").textContent = say("{used} of {number} used; force spectrum down 10 dB at {ten} Hz, 20 dB at {twenty} Hz",
    { used: taken, number: page.hits.length, ten: reply.usable[0], twenty: reply.usable[1] });
  part("gallery").dataset.used = taken;
  const some = accepted => page.hits.flatMap((hit, place) => hit.accepted === accepted ? [place] : []);
  const trace = (places, colour, symbol, name) => ({ x: places.map(place => place + 1), y: places.map(place => page.hits[place].peak), customdata: places, mode: "markers", name,
    marker: { color: colour, symbol, size: 7 }, hovertemplate: places.map(place => `${impact(page.hits[place])}<br>${page.hits[place].reason || say("used")}<extra></extra>`) });
  await Plotly.react("peaks", [trace(some(true), blue, "circle", say("used")), trace(some(false), vermilion, "square", say("not used"))],
    base({ xaxis: axis("Impact, in order of measurement"), yaxis: axis("Peak [N]", { rangemode: "tozero" }) }), quiet);
  const place = part("peaks");
  if (!place.dataset.wired) {
    place.dataset.wired = "1";
    place.on("plotly_click", event => { part("hit").value = event.points[0].customdata + 1; drawPulse(); });
  }
  part("hit").max = page.hits.length;
}

async function drawPulse() {
  const hit = Number(part("hit").value) - 1, one = (page.hits || [])[hit];
  part("impact").textContent = one ? `${impact(one)}: ${one.accepted ? say("used") : one.reason}` : "";
  if (!one) return;
  try {
    const reply = await get(`api/pulse?hit=${hit}`);
    await Plotly.react("pulse", [{ x: reply.time, y: reply.force, mode: "lines", line: { color: blue } }], base({ xaxis: axis("Time [ms]"), yaxis: axis("Force [N]") }), quiet);
  } catch (error) { fail(error.message); }
}

async function drawMap(overview) {
  part("maps").hidden = !overview.maps.length;
  if (!overview.maps.length || page.mapped) return;
  page.mapped = true;
  if (part("map").options.length !== overview.maps.length) part("map").replaceChildren(...overview.maps.map(name => new Option(name)));
  const reply = await get(`api/chart?map=${Math.max(part("map").selectedIndex, 0)}`);
  // normal force across and excitation up, as in reports; every cell says its number where numbers fit
  const few = reply.forces.length <= 12 && reply.levels.length <= 16;
  await Plotly.react("chart", [{ type: "heatmap", x: reply.forces, y: reply.levels, z: reply.damping, customdata: reply.frequency, colorscale: "Cividis", hoverongaps: false,
    texttemplate: few ? "%{z:.3g}" : "", textfont: { size: 12 },
    colorbar: { title: { text: say("Damping ratio [%]"), side: "right" }, thickness: 12 }, hovertemplate: "F_E %{y} N, F_N %{x} N<br>%{customdata} Hz, %{z} %<extra></extra>" }],
    base({ xaxis: axis("Normal force F_N [N]", { type: "category" }), yaxis: axis("Excitation force F_E [N]", { type: "category" }) }), quiet);
  const place = part("chart");
  if (!place.dataset.wired) {
    place.dataset.wired = "1";
    place.on("plotly_click", event => { const [level, force] = event.points[0].pointIndex; drawPoint(level, force).catch(error => fail(error.message)); });
  }
}

async function drawPoint(level, force) {
  const map = part("map").selectedIndex;
  const reply = await get(`api/point?map=${map}&level=${level}&force=${force}`);
  fine();
  const line = { color: "#1a1a1a", width: 1.3 };
  await Plotly.react("point", [{ x: reply.measured.f, y: reply.measured.magnitude, mode: "lines+markers", marker: { size: 3 }, line },
                               { x: reply.measured.f, y: reply.measured.phase, yaxis: "y2", mode: "lines", line }],
    base({ xaxis: axis("Frequency [Hz]", { anchor: "y2" }), yaxis: axis(reply.unit, { type: "log", domain: [0.36, 1], exponentformat: "power" }), yaxis2: axis("Phase [°]", { domain: [0, 0.3], tickvals: [-180, 0, 180] }),
      shapes: reply.f == null ? [] : [{ type: "line", x0: reply.f, x1: reply.f, yref: "paper", y0: 0, y1: 1, line: { color: vermilion, width: 1, dash: "dash" } }] }), quiet);
  part("seen").textContent = say("Run {run}, {frf}, next to F_E {level} N and F_N {force} N", { run: reply.run, frf: reply.label, level: reply.level, force: reply.force })
    + (reply.f == null ? `; ${say("a hole of the map")}` : `: ${reply.f} Hz, ${reply.zeta} %`);
  part("point").dataset.run = reply.run;
  if ([...part("run").options].some(one => one.value === reply.run) && part("run").value !== reply.run) await act("behind", { map, level, force });
}

async function drawPlacement(overview) {
  part("placements").hidden = !overview.placements.length;
  if (!overview.placements.length || page.placed) return;
  page.placed = true;
  if (part("placement").options.length !== overview.placements.length) part("placement").replaceChildren(...overview.placements.map(name => new Option(name)));
  page.placement = await get(`api/placement?number=${Math.max(part("placement").selectedIndex, 0)}`);
  const reply = page.placement;
  part("warning").hidden = !reply.warning; part("warning").textContent = reply.warning;
  part("kind").replaceChildren(...reply.kinds.map(name => new Option(name)));
  part("kind").selectedIndex = reply.kind[reply.ranked[0]];
  listPlaces();
  await drawPlaces();
  await drawPlace(reply.ranked[0]);
}

function listPlaces() {
  const reply = page.placement, kind = part("kind").selectedIndex;
  const name = candidate => { const rank = reply.ranked.indexOf(candidate), [x, y] = reply.centres[candidate];
    return new Option(`${rank < 0 ? "" : `${say("rank {rank}", { rank: rank + 1 })}: `}${x}, ${y} m`, candidate); };
  const here = reply.centres.flatMap((_, candidate) => reply.kind[candidate] === kind ? [candidate] : []);
  const order = candidate => { const rank = reply.ranked.indexOf(candidate); return rank < 0 ? reply.ranked.length + candidate : rank; };
  part("place").replaceChildren(...here.sort((a, b) => order(a) - order(b)).map(name));
}

async function drawPlaces(joints) {
  const reply = page.placement, kind = part("kind").selectedIndex;
  const here = reply.centres.flatMap((_, candidate) => reply.kind[candidate] === kind ? [candidate] : []);
  const known = here.filter(one => reply.score[one] != null), holes = here.filter(one => reply.score[one] == null);
  const at = (rows, axis) => rows.map(one => reply.centres[one][axis]);
  const [[x0, x1], [y0, y1]] = reply.extent;
  const broken = axis => reply.edges.flatMap(edge => [edge[0][axis], edge[1][axis], null]);
  const traces = [
    { x: broken(0), y: broken(1), mode: "lines", line: { color: faint, width: 1 }, hoverinfo: "skip" },
    { x: reply.points.map(one => one[0]), y: reply.points.map(one => one[1]), mode: "markers", marker: { symbol: "cross-thin", size: 5, line: { color: faint, width: 1 } }, hoverinfo: "skip" },
    { x: [x0, x1, x1, x0, x0], y: [y0, y0, y1, y1, y0], mode: "lines", line: { color: grey, width: 1 }, hoverinfo: "skip" },
    ...reply.keep_out.map(area => ({ x: [...area, area[0]].map(one => one[0]), y: [...area, area[0]].map(one => one[1]), mode: "lines", fill: "toself", fillcolor: "rgba(213,94,0,0.15)", line: { color: vermilion, width: 1 }, hoverinfo: "skip" })),
    { x: at(known, 0), y: at(known, 1), customdata: known, mode: "markers", name: "places",
      marker: { size: Math.max(7, Math.min(16, 220 / Math.sqrt(known.length || 1))), color: known.map(one => reply.score[one]), colorscale: "Cividis", colorbar: { title: { text: say("one mode [{unit}]", { unit: reply.unit }) }, thickness: 12 } },
      hovertemplate: known.map(one => `${reply.centres[one][0]}, ${reply.centres[one][1]} m<br>${reply.score[one]} ${reply.unit}<extra></extra>`) },
    { x: at(holes, 0), y: at(holes, 1), customdata: holes, mode: "markers", marker: { symbol: "x-thin", size: 7, line: { color: grey, width: 1 } }, hovertemplate: `${say("no resonance found")}<extra></extra>` },
  ];
  if (joints) traces.push({ x: joints.map(one => one[0]), y: joints.map(one => one[1]), mode: "lines+markers", line: { color: vermilion, width: 4 }, marker: { color: "#fff", size: 10, line: { color: vermilion, width: 2 } }, hoverinfo: "skip" });
  const ranks = reply.ranked.flatMap((one, rank) => reply.kind[one] === kind ? [{ x: reply.centres[one][0], y: reply.centres[one][1], text: String(rank + 1), showarrow: false, yshift: 14, font: { color: rank ? grey : vermilion, size: 12 } }] : []);
  await Plotly.react("places", traces, base({ annotations: ranks, uirevision: `${part("placement").selectedIndex}`, xaxis: axis("x [m]", { showgrid: false, constrain: "domain" }), yaxis: axis("y [m]", { showgrid: false, scaleanchor: "x", constrain: "domain" }) }), quiet);
  const place = part("places");
  if (!place.dataset.wired) {
    place.dataset.wired = "1";
    place.on("plotly_click", event => { const point = event.points.find(one => one.customdata !== undefined); if (point) drawPlace(point.customdata).catch(error => fail(error.message)); });
  }
}

async function drawPlace(candidate) {
  const reply = await get(`api/place?number=${Math.max(part("placement").selectedIndex, 0)}&candidate=${candidate}`);
  part("place").value = String(candidate);
  const bolts = reply.joints.map(([x, y]) => `(${x}, ${y}) m`).reduce((first, last) => say("{first} and {last}", { first, last }));
  part("location").textContent = (reply.rank ? `${say("Rank {rank}.", { rank: reply.rank })} ` : "") + say("Bolts at {bolts}; F_N {force} N in every joint", { bolts, force: reply.force })
    + (reply.best_forces.length ? ` (${say("best for each level: {forces} N", { forces: reply.best_forces.join(", ") })})` : "")
    + ". " + (reply.method === "all modes" ? say("Predicted with all modes together.") : say("Predicted with one mode at a time."));
  const number = (value, digits) => value == null ? "–" : Number(value).toFixed(digits);
  const rows = reply.modes.flatMap((mode, m) => reply.levels.map((level, k) => {
    const row = document.createElement("tr");
    const band = reply.low[m][k] == null ? "–" : `${number(reply.low[m][k], 2)} … ${number(reply.high[m][k], 2)}`;
    for (const text of [mode.mode, level, number(reply.f[m][k], 2), number(reply.zeta[m][k], 3), band, number(mode.bare_zeta, 3)]) row.insertCell().textContent = text;
    return row;
  }));
  part("forecast").tBodies[0].replaceChildren(...rows);
  part("flags").replaceChildren(...reply.flags.map(text => Object.assign(document.createElement("li"), { textContent: text })));
  await drawPlaces(reply.joints);
  part("places").dataset.candidate = candidate;
}

async function show(overview) {
  if (overview.revision === page.revision && page.run === overview.run && page.saved === overview.saved) return;
  page.revision = overview.revision; page.run = overview.run; page.saved = overview.saved;
  document.title = `${overview.title} – ema`;
  part("title").textContent = overview.title;
  if (part("run").options.length !== overview.runs.length) part("run").replaceChildren(...overview.runs.map(name => new Option(name)));
  part("run").value = overview.run;
  part("force").textContent = overview.force;
  part("undo").disabled = !overview.undo;
  part("undo").textContent = overview.undo ? say("Undo: {what}", { what: overview.undo }) : say("Undo");
  part("save").textContent = overview.saved ? say("Saved") : say("Save");
  part("save").title = say("s; to {path}", { path: overview.path });
  if (!part("who").value) part("who").value = overview.who;
  drawModes(overview);
  await Promise.all([drawPoles(overview), drawMotion(), drawMac(), drawFrf(), drawHits(), drawMap(overview), drawPlacement(overview)]);
  document.body.dataset.revision = overview.revision;
}
const refresh = () => { queue = queue.then(async () => { try { await show(await get("api/overview")); } catch (error) { fail(error.message); } }); };

part("run").addEventListener("change", () => act("run", { run: part("run").value }));
part("undo").addEventListener("click", () => act("undo"));
part("save").addEventListener("click", () => act("save"));
part("close").addEventListener("click", fine);
part("output").addEventListener("change", () => drawFrf().catch(error => fail(error.message)));
part("input").addEventListener("change", () => drawFrf().catch(error => fail(error.message)));
part("hit").addEventListener("change", drawPulse);
part("map").addEventListener("change", () => { page.mapped = false; get("api/overview").then(drawMap).catch(error => fail(error.message)); });
part("placement").addEventListener("change", () => { page.placed = false; get("api/overview").then(drawPlacement).catch(error => fail(error.message)); });
part("kind").addEventListener("change", () => { listPlaces(); drawPlace(Number(part("place").value)).catch(error => fail(error.message)); });
part("place").addEventListener("change", () => drawPlace(Number(part("place").value)).catch(error => fail(error.message)));
part("near").addEventListener("submit", event => { event.preventDefault(); act("near", { frequency: Number(part("frequency").value) }); });
part("exclude").addEventListener("submit", event => { event.preventDefault(); act("exclude", { hit: Number(part("hit").value) - 1, why: part("why").value, who: part("who").value }); });
part("export").addEventListener("change", async () => {
  const kind = part("export").value;
  part("export").value = "";
  if (!kind) return;
  try {
    const answer = await ask(`export?kind=${kind}`);
    const name = (answer.headers.get("Content-Disposition") || "").split('"')[1] || kind;
    const link = Object.assign(document.createElement("a"), { href: URL.createObjectURL(await answer.blob()), download: name });
    document.body.append(link); link.click(); link.remove();
    setTimeout(() => URL.revokeObjectURL(link.href), 10000);
  } catch (error) { fail(error.message); }
});
document.addEventListener("keydown", event => {
  if (event.ctrlKey || event.metaKey || event.altKey || ["INPUT", "SELECT"].includes(event.target.tagName)) return;
  if (event.key === "u" && !part("undo").disabled) act("undo");
  if (event.key === "s") act("save");
});
follow(news => {
  if (news.again) page.revision = -1; else part("busy").textContent = news.busy ? say("working …") : "";
  if (!news.busy) refresh();
});
refresh();

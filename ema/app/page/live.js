"use strict";
const line = (x, y, colour, more = {}) => Object.assign({ x, y, mode: "lines", line: { color: colour, width: 1.3 } }, more);
let shown = -1;

async function drawTake(reply) {
  const { take, force, spectrum, response, frf } = reply;
  const said = { point: take.point, number: take.number, peak: take.peak, force: take.normal_force };
  part("verdict").textContent = (take.accepted ? say("Point {point}, take {number}: accepted. Peak {peak}, F_N {force}.", said) : say("Point {point}, take {number}: REJECTED. Peak {peak}, F_N {force}.", said));
  part("verdict").classList.toggle("rejected", !take.accepted);
  part("remarks").textContent = [...take.reasons, ...take.remarks].join(" ");
  if (force) await Plotly.react("force", [line(force.time, force.value, blue)], base({ xaxis: axis("Time from the peak [ms]"), yaxis: axis("Force [N]") }), quiet);
  if (spectrum) await Plotly.react("spectrum", [line(spectrum.f, spectrum.decibels, blue)],
    base({ xaxis: axis("Frequency [Hz]"), yaxis: axis("dB re its maximum", { range: [-60, 3] }) }), quiet);
  if (response) await Plotly.react("response", [line(response.time, response.value, blue)], base({ xaxis: axis("Time [s]"), yaxis: axis(response.label) }), quiet);
  part("label").textContent = frf ? frf.label : say("no take at this point counts yet");
  const traces = frf ? [line(frf.measured.f, frf.measured.magnitude, "#1a1a1a"), line(frf.measured.f, frf.measured.phase, "#1a1a1a", { yaxis: "y2" })] : [];
  if (frf && frf.coherence) traces.push(line(frf.coherence.f, frf.coherence.value, blue, { yaxis: "y3" }));
  await Plotly.react("frf", traces, base({ xaxis: axis("Frequency [Hz]", { anchor: "y3" }),
    yaxis: axis(frf ? frf.unit : "", { type: "log", domain: [0.45, 1], exponentformat: "power" }), yaxis2: axis("Phase [°]", { domain: [0.2, 0.42], range: [-190, 190], tickvals: [-180, 0, 180] }),
    yaxis3: axis("Coh.", { domain: [0, 0.16], range: [0, 1.02] }) }), quiet);
}

async function drawPeaks(peaks) {
  const trace = (accepted, colour, symbol, name) => {
    const rows = peaks.flatMap((one, row) => one.accepted === accepted ? [row] : []);
    return { x: rows.map(row => row + 1), y: rows.map(row => peaks[row].peak), text: rows.map(row => `${say("point {point}", { point: peaks[row].point })}, ${name}`), mode: "markers", marker: { color: colour, symbol, size: 8 }, hovertemplate: "%{text}<br>%{y} N<extra></extra>" };
  };
  await Plotly.react("peaks", [trace(true, blue, "circle", say("accepted")), trace(false, vermilion, "square", say("rejected"))],
    base({ xaxis: axis("Take, in order of measurement", { rangemode: "tozero" }), yaxis: axis("Peak [N]", { rangemode: "tozero" }) }), quiet);
}

let drawing = Promise.resolve();
function refresh() {
  drawing = drawing.then(async () => {
    try {
      const reply = await get("api/take");
      document.title = `${reply.title} – ema record`;
      part("title").textContent = reply.title;
      part("asked").textContent = reply.asked;
      if (reply.revision === shown) return;
      if (reply.take) { await drawTake(reply); await drawPeaks(reply.peaks); }
      shown = reply.revision;
      document.body.dataset.revision = shown;
    } catch (error) { fail(error.message); }
  });
}
part("close").addEventListener("click", fine);
follow(refresh);
refresh();

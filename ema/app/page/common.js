"use strict";
const token = new URLSearchParams(location.search).get("token") || "";
const part = id => document.getElementById(id);
const blue = "#0072b2", vermilion = "#d55e00", grey = "#7a7a7a", faint = "#c4c4c4";
const quiet = { displaylogo: false, responsive: true, modeBarButtonsToRemove: ["lasso2d", "select2d"] };
const say = (message, values = {}) => (words[message] || message).replace(/\{(\w+)\}/g, (whole, name) => name in values ? values[name] : whole);
const gone = () => document.body.dataset.gone;

function fail(text) { part("what").textContent = text; part("error").hidden = false; }
function fine() { part("error").hidden = true; }

async function ask(path, options = {}) {
  const url = new URL(path, location.href);
  if (token) url.searchParams.set("token", token);
  let answer;
  try { answer = await fetch(url, options); } catch { throw new Error(gone()); }
  if (!answer.ok) {
    let reply = say("The server answers {status}.", { status: answer.status });
    try { reply = (await answer.json()).error || reply; } catch { /* no words came with it */ }
    throw new Error(reply);
  }
  return answer;
}
const get = async path => (await ask(path)).json();

function base(more) {
  return Object.assign({ margin: { l: 62, r: 20, t: 14, b: 42 }, showlegend: false, hovermode: "closest", paper_bgcolor: "#fff", plot_bgcolor: "#fff",
    font: { family: "inherit", size: 12, color: "#1c2530" } }, more);
}
const axis = (title, more = {}) => Object.assign({ title: { text: say(title) }, gridcolor: "#e9e9e9", zeroline: false, linecolor: grey, automargin: true }, more);

window.addEventListener("unhandledrejection", event => fail(String(event.reason && event.reason.message || event.reason)));
window.addEventListener("error", event => fail(event.message));

function follow(changed) {
  const events = new EventSource(`events${token ? `?token=${encodeURIComponent(token)}` : ""}`);
  events.onmessage = event => changed(JSON.parse(event.data));
  events.onopen = () => { if (part("error").dataset.gone) { delete part("error").dataset.gone; fine(); changed({ again: true }); } };
  events.onerror = () => { part("error").dataset.gone = "1"; fail(gone()); };
}

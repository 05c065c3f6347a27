// Fields are chosen by a press and dragged onto plots; `chosen` and `dropped` tell the server.
const find = (event, wanted) => event.composedPath().find(n => n.classList && wanted(n));
const field = event => find(event, n => n.dataset && n.dataset.field !== undefined);
const target = event => find(event, n => [...n.classList].some(c => c.startsWith("drop-")));
const pressed = new Set(JSON.parse(chosen.value || "[]"));
let over = null, drops = 0;

const mark = one => {
    if (over && over !== one) over.style.outline = "";
    over = one;
    if (one) one.style.outline = "3px solid var(--accent)";
};
document.addEventListener("click", event => {
    const one = field(event);
    if (!one) return;
    const name = one.dataset.field, on = !pressed.has(name);
    if (on) pressed.add(name); else pressed.delete(name);
    one.setAttribute("aria-pressed", on);
    chosen.value = JSON.stringify([...pressed]);
});
chosen.properties.value.change.connect(() => {  // the server has put them onto a plot
    if (chosen.value === "[]") pressed.clear();
});
document.addEventListener("dragstart", event => {
    const one = field(event);
    if (!one) return;
    const name = one.dataset.field;
    event.dataTransfer.setData("text/plain", JSON.stringify(pressed.has(name) ? [...pressed] : [name]));
    event.dataTransfer.effectAllowed = "copy";
});
document.addEventListener("dragover", event => {
    const one = target(event);
    mark(one || null);
    if (one) event.preventDefault();
});
document.addEventListener("dragend", () => mark(null));
document.addEventListener("drop", event => {
    const one = target(event);
    mark(null);
    if (!one) return;
    event.preventDefault();
    const plot = [...one.classList].find(c => c.startsWith("drop-")).slice(5);
    dropped.value = JSON.stringify([plot, event.dataTransfer.getData("text/plain"), ++drops]);
});

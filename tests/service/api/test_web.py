"""What holds for the whole application: problems, access, description, probes, metrics, the page."""

from __future__ import annotations

import hashlib
import re
from html.parser import HTMLParser
from pathlib import Path

import pytest

from service.api.metrics import Family, render
from service.api.problems import MEDIA_TYPE
from service.api.words import in_words
from service.backlash.results import Reason
from tests.service.api.house import House

PROBLEMS = [
    ("GET", "/nowhere", 404),
    ("GET", "/api/v1/nowhere", 404),
    ("GET", "/api/v1/axes/Q", 404),
    ("GET", "/api/v1/runs/7", 404),
    ("GET", "/api/v1/runs/7/capture", 404),
    ("GET", "/api/v1/alarms/7", 404),
    ("POST", "/api/v1/alarms/7/acknowledge", 422),
    ("DELETE", "/api/v1/axes", 405),
    ("GET", "/api/v1/checks", 405),
    ("PUT", "/livez", 405),
    ("GET", "/api/v1/runs/zero", 422),
    ("GET", "/api/v1/runs/0", 422),
    ("GET", f"/api/v1/runs/{2**63}", 422),
    ("GET", "/api/v1/runs?limit=0", 422),
    ("GET", "/api/v1/axes/X1/history?cursor=x", 422),
    ("GET", "/api/v1/axes/X1/history?cursor=%F0%9F%92%A9", 422),
    ("POST", "/api/v1/checks", 422),
]


@pytest.mark.parametrize(("method", "path", "status"), PROBLEMS)
def test_every_error_is_a_problem(house: House, method: str, path: str, status: int) -> None:
    response = house.client.request(method, path)
    assert (response.status_code, response.headers["Content-Type"]) == (status, MEDIA_TYPE)
    problem = response.json()
    assert (problem["status"], problem["instance"]) == (status, path.split("?")[0])
    assert {"type", "title", "detail"} <= problem.keys()


@pytest.mark.parametrize(
    ("path", "allow"), [("/api/v1/checks", "POST"), ("/api/v1/alarms", "GET"), ("/api/v1/runs/1", "GET")]
)
def test_a_wrong_method_names_the_right_ones(house: House, path: str, allow: str) -> None:
    assert house.client.patch(path).headers["Allow"] == allow


def test_a_fault_of_the_program_is_a_problem_that_tells_no_secrets(
    house: House, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fail() -> None:
        raise RuntimeError("the password is swordfish")

    monkeypatch.setattr(house.repository, "axes", fail)
    response = house.client.get("/api/v1/axes")
    assert (response.status_code, response.headers["Content-Type"]) == (500, MEDIA_TYPE)
    assert "swordfish" not in response.text
    assert "journal" in response.json()["detail"]


def test_a_large_body_and_one_of_unknown_length_are_refused(house: House) -> None:
    large = house.client.post("/api/v1/checks", content=b" " * 70_000)
    assert (large.status_code, large.headers["Content-Type"]) == (413, MEDIA_TYPE)
    chunked = house.client.post("/api/v1/checks", content=iter([b'{"axis": "X1"}']))
    assert (chunked.status_code, chunked.headers["Content-Type"]) == (411, MEDIA_TYPE)


def test_another_web_site_cannot_move_the_machine(house: House) -> None:
    """A page of another site may send simple requests; and by DNS rebinding it may take this service's name."""
    body = '{"axis": "X1"}'
    foreign = {"Origin": "https://evil.example", "Content-Type": "application/json"}
    own = {"Origin": "http://127.0.0.1:8470", "Content-Type": "application/json"}
    assert house.client.post("/api/v1/checks", content=body, headers=foreign).status_code == 403
    assert (
        house.client.post("/api/v1/checks", content=body, headers={"Content-Type": "text/plain"}).status_code
        == 422
    )
    rebound = {"Host": "evil.example:8470", "Content-Type": "application/json"}
    assert house.client.post("/api/v1/checks", content=body, headers=rebound).status_code == 403
    assert house.client.get("/api/v1/axes", headers={"Host": "evil.example"}).status_code == 403
    assert house.get("/api/v1/runs")["items"] == []
    assert house.client.post("/api/v1/checks", content=body, headers=own).status_code == 202


@pytest.mark.parametrize("host", ["localhost:8470", "localhost", "[::1]:8470", "[::1]", "127.0.0.1:9"])
def test_all_names_of_the_loopback_are_answered(house: House, host: str) -> None:
    assert house.client.get("/api/v1/axes", headers={"Host": host}).status_code == 200


def test_with_a_token_nothing_is_said_without_it(house: House) -> None:
    client = house.rebuild(token_sha256=hashlib.sha256(b"opaque").hexdigest())
    for path in ("/api/v1/axes", "/api/v1/status", "/metrics"):
        refused = client.get(path)
        assert (refused.status_code, refused.headers["WWW-Authenticate"]) == (401, "Bearer")
        assert client.get(path, headers={"Authorization": "Bearer wrong"}).status_code == 401
        assert client.get(path, headers={"Authorization": "Basic opaque"}).status_code == 401
        assert client.get(path, headers={"Authorization": "Bearer opaque"}).status_code == 200
    assert client.get("/livez").status_code == client.get("/").status_code == 200
    named = {"Authorization": "Bearer opaque", "Host": "machine7.plant.example"}
    assert client.get("/api/v1/axes", headers=named).status_code == 200


def test_every_field_and_parameter_is_described(house: House) -> None:
    described = house.get("/openapi.json")
    for name, schema in described["components"]["schemas"].items():
        for field, content in schema.get("properties", {}).items():
            assert content.get("description"), f"{name}.{field}"
    for path, methods in described["paths"].items():
        for method, operation in methods.items():
            assert operation["summary"], f"{method} {path}"
            for parameter in operation.get("parameters", []):
                assert parameter.get("description"), f"{method} {path}: {parameter['name']}"


def test_every_number_with_a_dimension_names_its_unit(house: House) -> None:
    """A float field's name ends with its unit and its description holds it in brackets."""
    units = {"_m_s3": "[m/s³]", "_m": "[m]", "_s": "[s]", "_m_per_day": "[m/day]"}
    for name, schema in house.get("/openapi.json")["components"]["schemas"].items():
        if name.startswith("ByProduct"):
            continue  # its unit stands beside it, in the field `unit`
        for field, content in schema.get("properties", {}).items():
            if '"number"' not in str(content).replace("'", '"'):
                continue
            if "unit" in content.get("description", ""):
                continue  # the channel's, which is named beside it, or none
            unit = next((sign for end, sign in units.items() if field.endswith(end)), None)
            assert unit is not None, f"{name}.{field}"
            assert unit in content["description"], f"{name}.{field}"


def test_problems_are_described_as_problems(house: House) -> None:
    described = house.get("/openapi.json")
    assert "HTTPValidationError" not in described["components"]["schemas"]
    for path, methods in described["paths"].items():
        for operation in methods.values():
            for status, response in operation["responses"].items():
                if int(status) >= 400:
                    assert list(response["content"]) == [MEDIA_TYPE], f"{path} {status}"
    assert "409" in described["paths"]["/api/v1/checks"]["post"]["responses"]


def test_probes(house: House) -> None:
    assert house.get("/livez") == house.get("/readyz") == {"status": "ok"}
    house.missing.append("the bus can0 is off: check its cable")
    assert house.get("/livez") == {"status": "ok"}
    response = house.client.get("/readyz")
    assert (response.status_code, response.json()["detail"]) == (503, house.missing[0])
    assert house.get("/api/v1/status")["not_ready"] == house.missing


def test_metrics_are_prometheus_text(nights: House) -> None:
    response = nights.client.get("/metrics")
    assert response.headers["Content-Type"].startswith("text/plain; version=0.0.4")
    lines = response.text.splitlines()
    sample = re.compile(r'[a-z_]+(\{([a-z_]+="([^"\\]|\\.)*",?)+\})? -?[0-9.e+-]+$')
    assert all(line.startswith("# ") or sample.match(line) for line in lines)
    assert 'flankwatch_backlash_metres{axis="X1",group="gantry"} 8e-05' in lines
    assert 'flankwatch_alarm{axis="X1",group="gantry",kind="backlash_high",is="active"} 1.0' in lines
    assert 'flankwatch_alarm{axis="Y",group="Y",kind="run_missing",is="active"} 0.0' in lines
    assert 'flankwatch_runs_total{state="ok"} 21.0' in lines
    assert not any('flankwatch_backlash_metres{axis="X2"' in line for line in lines)


@pytest.mark.parametrize("file", ["prometheus/flankwatch.rules.yml", "grafana/flankwatch.json"])
def test_rules_and_dashboard_ask_for_metrics_that_exist(nights: House, file: str) -> None:
    text = (Path(__file__).parents[3] / "deploy" / file).read_text(encoding="utf-8")
    asked = set(re.findall(r"flankwatch_[a-z_]+", text))
    given = set(re.findall(r"^# TYPE (\S+)", nights.client.get("/metrics").text, re.MULTILINE))
    assert asked <= given
    assert len(asked) >= 3


def test_labels_are_escaped() -> None:
    family = Family("f", "help", [((("axis", 'a"\\\nb'),), 1.0)])
    assert render([family]).splitlines()[2] == r'f{axis="a\"\\\nb"} 1.0'


@pytest.mark.parametrize("reason", list(Reason))
def test_every_reason_has_words(reason: Reason) -> None:
    words = in_words(reason)
    assert words is not None
    assert words != reason.replace("_", " ").capitalize() + "."


def test_an_unknown_reason_is_still_readable() -> None:
    assert in_words("brake_worn") == "Brake worn."
    assert in_words("BrakeWorn") == "Brake worn."


class Links(HTMLParser):
    """Collects what a page makes the browser fetch."""

    def __init__(self) -> None:
        super().__init__()
        self.found: list[str] = []
        self.ids: list[str] = []
        self.labelled: list[str] = []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        for name, content in attrs:
            if name in ("src", "href") and content:
                self.found.append(content)
            if name == "id" and content:
                self.ids.append(content)
            if name == "aria-labelledby" and content:
                self.labelled.append(content)


def test_the_page_asks_nobody_else(house: House) -> None:
    page = house.client.get("/")
    links = Links()
    links.feed(page.text)
    policy = page.headers["Content-Security-Policy"]
    assert "default-src 'none'" in policy
    assert "http" not in policy
    for link in links.found:
        assert link.startswith("/"), link
        assert house.client.get(link).status_code == 200, link
    scripts = {link for link in links.found if link.endswith(".js")}
    seen: set[str] = set()
    while scripts - seen:
        script = (scripts - seen).pop()
        seen.add(script)
        text = house.client.get(script).text
        assert "http://www.w3.org/2000/svg" in text or "://" not in text.replace("// ", ""), script
        scripts |= {f"/static/{name}" for name in re.findall(r'from "\./([a-z]+\.js)"', text)}
    assert seen == {
        f"/static/{name}.js" for name in ("page", "cards", "chart", "dom", "map", "products", "runs")
    }
    assert set(links.labelled) <= set(links.ids)


def test_the_scripts_know_only_elements_that_the_page_has(house: House) -> None:
    links = Links()
    links.feed(house.client.get("/").text)
    text = "".join(house.client.get(f"/static/{name}.js").text for name in ("page", "dom"))
    assert set(re.findall(r'\$\("([a-z-]+)"\)', text)) <= set(links.ids)
    assert "innerHTML" not in text.replace("without innerHTML", "")

"""OpenAPI document of the console's API, made from the table of routes."""

from __future__ import annotations

import re
from collections.abc import Iterable
from typing import TYPE_CHECKING, Any

from pydantic.json_schema import models_json_schema

from acquire.console.web.orders import ErrorAnswer

if TYPE_CHECKING:
    from acquire.console.web.routes import ApiRoute

REFERENCE = "#/components/schemas/{model}"


def openapi_document(routes: Iterable[ApiRoute]) -> dict[str, Any]:
    """OpenAPI 3.1 document of the routes: parameters, bodies, answers and errors.

    Args:
        routes: the table of routes.
    """
    routes = list(routes)
    models = {ErrorAnswer} | {
        each for route in routes for each in (route.body, route.answer) if isinstance(each, type)
    }
    ordered = sorted(models, key=lambda model: model.__name__)
    _, schemas = models_json_schema([(each, "validation") for each in ordered], ref_template=REFERENCE)
    paths: dict[str, dict[str, Any]] = {}
    for route in routes:
        paths.setdefault(route.path, {})[route.method.lower()] = _operation(route)
    return {
        "openapi": "3.1.0",
        "info": {
            "title": "Percuss console",
            "version": "1",
            "description": (
                "A request needs the console's cookie, or from a script `Authorization: Bearer KEY.NAME`. "
                "Every POST needs the headers `Origin` and `X-Percuss: 1` and a JSON body."
            ),
        },
        "paths": paths,
        "components": {
            "schemas": schemas["$defs"],
            "securitySchemes": {
                "cookie": {"type": "apiKey", "in": "cookie", "name": "percuss_console_PORT"},
                "script": {"type": "http", "scheme": "bearer"},
            },
        },
        "security": [{"cookie": []}, {"script": []}],
    }


def _operation(route: ApiRoute) -> dict[str, Any]:
    parameters: list[dict[str, Any]] = [
        {"name": name, "in": "path", "required": True, "schema": {"type": "string"}}
        for name in re.findall(r"{(\w+)}", route.path)
    ]
    operation: dict[str, Any] = {
        "summary": route.summary,
        "operationId": re.sub(r"\W+", "_", f"{route.method.lower()}{route.path}").strip("_"),
        "responses": {
            "200": {"description": "Done.", "content": _content(route)},
            "default": {
                "description": "Refused.",
                "content": {"application/json": {"schema": _reference(ErrorAnswer)}},
            },
        },
    }
    if route.method == "POST":
        header = {"type": "string", "const": "1"}
        parameters.append({"name": "X-Percuss", "in": "header", "required": True, "schema": header})
    if parameters:
        operation["parameters"] = parameters
    if route.body is not None:
        schema = _reference(route.body)
        operation["requestBody"] = {"required": True, "content": {"application/json": {"schema": schema}}}
    return operation


def _content(route: ApiRoute) -> dict[str, Any]:
    if isinstance(route.answer, str):
        return {route.answer: {}}
    schema = _reference(route.answer)
    return {"application/json": {"schema": {"type": "array", "items": schema} if route.many else schema}}


def _reference(model: type) -> dict[str, str]:
    return {"$ref": REFERENCE.format(model=model.__name__)}

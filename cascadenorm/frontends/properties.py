"""Filter properties for every control and every method parameter, generated from their declarations."""

from collections.abc import Callable, Iterator
from typing import Any, NamedTuple

from cascadenorm.api.api import DEFAULT_METHOD, methods
from cascadenorm.registry import Setting
from cascadenorm.registry.controls import CONTROLS

Filter = type[Any]


class FilterProperty(NamedTuple):
    """A property of a filter, with a setter and a getter such as `SetKeepDetail` and `GetKeepDetail`."""

    # Name, such as KeepDetail for the control keep_detail or TaubinIterations for iterations of the method taubin
    name: str
    setting: Setting  # type, default and range
    # Name of the method that has this parameter. Empty for a control.
    method: str
    help: str

    @property
    def default(self) -> Any:
        """The default; an empty string stands for None."""
        return "" if self.setting.default is None else self.setting.default


def properties() -> Iterator[FilterProperty]:
    """Yield the visible controls, then the parameters of each method."""
    for name, control in CONTROLS.items():
        if not control.about.hidden:
            yield FilterProperty(_camel(name), control, "", control.help(""))
    for method in methods().values():
        for setting in method.given_by_name:
            values = ", ".join(filter(None, (setting.about.unit, setting.about.allowed)))
            about = f"{setting.about.help} ({values})." if values else f"{setting.about.help}."
            yield FilterProperty(_camel(method.name) + _camel(setting.name), setting, method.name, about)


def with_properties(kind: Filter) -> Filter:
    """Add a setter and a getter for each property to a filter class; `_values` holds the values."""
    for property in properties():
        setattr(kind, f"Set{property.name}", _setter(property))
        setattr(kind, f"Get{property.name}", _getter(property))
    return kind


def settings_of(values: dict[str, Any], method: str = DEFAULT_METHOD) -> dict[str, Any]:
    """Return the values as keyword arguments of `denoise`: the controls and the parameters of one method."""
    return {
        property.setting.name: values[property.name]
        for property in properties()
        if property.name in values and property.method in ("", method)
    }


def setting_name(name: str, value: object = None) -> str:
    """Return the name of a control in a filter, for messages; method parameters keep their names."""
    if name not in CONTROLS:
        return name
    return _camel(name) if value is None else f"Set{_camel(name)}({value!r})"


def _camel(name: str) -> str:
    return "".join(part[:1].upper() + part[1:] for part in name.replace("-", "_").split("_"))


def _setter(property: FilterProperty) -> Callable[[Any, Any], None]:
    def set_value(self: Any, value: Any) -> None:
        new = property.setting.default if isinstance(value, str) and value == "" else property.setting.checked(value)
        if isinstance(new, float | int | str | None) and new == getattr(self, f"Get{property.name}")():
            return
        self._values[property.name] = new
        self.Modified()

    set_value.__name__, set_value.__doc__ = f"Set{property.name}", property.help
    return set_value


def _getter(property: FilterProperty) -> Callable[[Any], Any]:
    def value(self: Any) -> Any:
        return self._values.get(property.name, property.setting.default)

    value.__name__, value.__doc__ = f"Get{property.name}", property.help
    return value

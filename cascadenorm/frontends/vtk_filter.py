"""A filter for pipelines of VTK, in Python, ParaView or 3D Slicer."""

from typing import Any

from vtkmodules.util.vtkAlgorithm import VTKPythonAlgorithmBase
from vtkmodules.vtkCommonCore import vtkOutputWindow
from vtkmodules.vtkCommonDataModel import vtkDataObject
from vtkmodules.vtkCommonExecutionModel import vtkAlgorithm

from cascadenorm.api.api import DEFAULT_METHOD
from cascadenorm.errors import CascadenormError
from cascadenorm.execution.progress import Cancelled
from cascadenorm.frontends.properties import setting_name, settings_of, with_properties
from cascadenorm.frontends.vtk_data import denoised
from cascadenorm.registry import find

INPUT_TYPES = ("vtkPolyData", "vtkMultiBlockDataSet", "vtkPartitionedDataSetCollection", "vtkPartitionedDataSet")


@with_properties
class DenoiseFilter(VTKPythonAlgorithmBase):
    """Denoise a vtkPolyData of triangles, or the blocks of a composite dataset together, whose walls stay shared.

    Controls have setters and getters such as `SetStrength` and `GetKeepDetail`, and parameters of a method such as
    `SetTaubinIterations`; an empty string stands for the default. `mask` and `fixed` may be names of point arrays,
    `only` that of a cell array, or array=value. Progress is reported as a ProgressEvent, and `SetAbortExecute(1)` in
    an observer aborts the execution with an empty output. Errors go to the vtkOutputWindow.

    Attributes
    ----------
    error
        The error that ended the last execution. None if it succeeded.
    """

    def __init__(self) -> None:
        super().__init__(nInputPorts=1, inputType="vtkPolyData", nOutputPorts=1, outputType="vtkDataObject")
        self._method = DEFAULT_METHOD
        self._values: dict[str, Any] = {}
        self.error: CascadenormError | None = None

    def SetInputData(self, data: Any) -> None:
        """Use a dataset as input instead of the output of another filter."""
        self.SetInputDataObject(0, data)

    def GetOutput(self) -> Any:
        """Return the output, of the type of the input."""
        return self.GetOutputDataObject(0)

    def SetMethod(self, name: str) -> None:
        if find(name).name != self._method:
            self._method = name
            self.Modified()

    def GetMethod(self) -> str:
        return self._method

    def FillInputPortInformation(self, port: int, info: Any) -> int:
        """Declare the accepted types of data."""
        for kind in INPUT_TYPES:
            info.Append(vtkAlgorithm.INPUT_REQUIRED_DATA_TYPE(), kind)
        return 1

    def RequestDataObject(self, request: Any, inputs: Any, outputs: Any) -> int:
        """Make an output of the type of the input."""
        given, out = self.GetInputData(inputs, 0, 0), outputs.GetInformationObject(0)
        present = out.Get(vtkDataObject.DATA_OBJECT())
        if present is None or present.GetClassName() != given.GetClassName():
            out.Set(vtkDataObject.DATA_OBJECT(), given.NewInstance())
        return 1

    def RequestData(self, request: Any, inputs: Any, outputs: Any) -> int:
        given, out = self.GetInputData(inputs, 0, 0), self.GetOutputData(outputs, 0)
        settings = {**settings_of(self._values, self._method), "method": self._method, "progress": self._progress}
        self.error = None
        try:
            out.ShallowCopy(denoised(given, settings))
        except Cancelled:
            out.Initialize()
        except CascadenormError as error:
            out.Initialize()
            self.error = error
            vtkOutputWindow.GetInstance().DisplayErrorText(f"cascadenorm: {error.message(setting_name)}\n")
            return 0
        return 1

    def _progress(self, fraction: float) -> None:
        self.UpdateProgress(fraction)
        if self.GetAbortExecute():
            raise Cancelled

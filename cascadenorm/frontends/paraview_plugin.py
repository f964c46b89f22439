"""A plugin for ParaView: load it with Tools > Manage Plugins > Load New; the filter is Filters > Denoise Mesh."""

from paraview.util.vtkAlgorithm import smproperty, smproxy

from cascadenorm.frontends.paraview_xml import declaration
from cascadenorm.frontends.vtk_filter import DenoiseFilter


@smproxy.filter(name="DenoiseMesh", label="Denoise Mesh")
@smproperty.xml(declaration())
class DenoiseMesh(DenoiseFilter):
    """The filter under its name in ParaView."""
